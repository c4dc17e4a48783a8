"""What a pipeline leaves as it was: the caller's networks, random numbers, modes and threads."""

from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from spot_fits import SIDE, TRUTH, Spot, pipeline, spots, starts_anywhere
from torch import nn

from kfit.callbacks import Pruning
from kfit.core import Encoder, Observation, Variable
from kfit.energies import L2, Silhouette
from kfit.initializers import EncoderPosterior
from kfit.optimizers import Adam


class TestSurroundings:
    def test_the_original_generator_is_left_as_it_was(self):
        generator = Spot().train()
        fit = pipeline(generator=generator)
        fit(spots(), seed=0)
        assert generator.training
        assert generator.blur.training
        assert generator.ink.requires_grad
        assert generator.ink.grad is None
        assert fit.generator.ink.data_ptr() == generator.ink.data_ptr()

    def test_a_pipeline_stays_in_evaluation_mode_inside_a_module_in_training(self):
        fit = pipeline()
        expected = fit(spots(), seed=0)
        whole = nn.ModuleList([fit]).train()
        assert whole.training
        assert not any(module.training for module in fit.modules())
        torch.testing.assert_close(fit(spots(), seed=0).energy, expected.energy, rtol=0, atol=0)

    def test_a_later_training_of_the_generator_is_seen(self):
        generator = Spot()
        fit = pipeline(generator=generator)
        before = fit(spots(), seed=0)
        with torch.no_grad():
            generator.ink.mul_(0.5)
        assert not torch.allclose(fit(spots(), seed=0).energy, before.energy)

    @pytest.mark.parametrize("inside", [torch.inference_mode, torch.no_grad, torch.enable_grad])
    def test_a_fit_gives_the_same_answer_inside_any_gradient_mode(self, inside):
        fit = pipeline(energies={"image": L2(), "mask": Silhouette()})
        expected = fit(spots(), seed=0)
        with inside():
            for observed in (spots(), Observation(spots().image, spots().mask + 0, keys=spots().keys)):
                torch.testing.assert_close(fit(observed, seed=0).energy, expected.energy, rtol=0, atol=0)
        assert torch.is_grad_enabled()

    def test_a_picture_from_outside_and_a_mask_from_inside_inference_mode_go_together(self):
        fit, observed = pipeline(energies={"image": L2(), "mask": Silhouette()}), spots()
        expected = fit(observed, seed=0)
        with torch.inference_mode():
            mixed = Observation(observed.image, observed.mask.clone(), keys=observed.keys)
        assert mixed.mask.is_inference()
        assert not mixed.image.is_inference()
        torch.testing.assert_close(fit(mixed, seed=0).energy, expected.energy, rtol=0, atol=0)

    def test_a_pipeline_built_in_inference_mode_fits_outside_it(self):
        generator = Spot()
        with torch.inference_mode():
            fit = pipeline(generator=generator)
        torch.testing.assert_close(fit(spots(), seed=0).energy, pipeline()(spots(), seed=0).energy)

    def test_four_threads_at_once_get_the_answers_that_they_get_alone(self):
        fit = pipeline(callbacks=[Pruning({4: 2})])
        observed = [spots(rows=rows) for rows in ((0,), (1, 2), (2, 0, 1), (1,))]
        alone = [fit(observation, seed=number) for number, observation in enumerate(observed)]
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(lambda number: fit(observed[number], seed=number), range(4)))
        for one, other in zip(together, alone, strict=True):
            torch.testing.assert_close(one.history.energy, other.history.energy, rtol=0, atol=0, equal_nan=True)
            assert one.start.tolist() == other.start.tolist()
            assert one.num_evaluations == other.num_evaluations

    def test_bound_generators_fit_what_is_left(self):
        fixed = {name: torch.tensor(TRUTH[name][0], dtype=torch.float64) for name in ("radius", "angle")}
        fit = pipeline(
            generator=Spot().bind(**fixed), initializers=starts_anywhere()[:2], optimizer=Adam(0.05), num_steps=80
        )
        result = fit(spots(rows=(0,)), seed=0)
        assert set(result.values) == {"x", "y"}
        assert float(result.values["x"]) == pytest.approx(0.3, abs=5e-3)

    def test_moving_a_pipeline_moves_the_networks_of_its_initializers(self):
        class Guess(Encoder):
            def __init__(self):
                super().__init__()
                self.layer = nn.Linear(3 * SIDE**2, 2)

            def forward(self, image):
                mean, log_variance = self.layer(image.flatten(1)).chunk(2, 1)
                return mean, log_variance

        class Scaled(Spot):
            def __init__(self):
                super().__init__()
                self.variables = {"code": Variable((1,))}

            def forward(self, code):
                fixed = {name: torch.full_like(code[:, 0], TRUTH[name][0]) for name in ("y", "radius", "angle")}
                return super().forward(x=code[:, 0], **fixed)

        guess = Guess().train()
        fit = pipeline(generator=Scaled(), initializers=[EncoderPosterior(guess)], optimizer=Adam(0.02), num_steps=2)
        assert fit.double()(spots(rows=(0,)), seed=0).values["code"].dtype == torch.float64
        assert guess.layer.weight.dtype == torch.float32
        assert guess.training

"""A pipeline written down and read again, and what parts show of themselves."""

import pytest
import torch
import yaml
from jsonargparse import ArgumentParser

from kfit import FitPipeline
from kfit.callbacks import Pruning, Stopping
from kfit.core import Energy, Observation
from kfit.energies import L2, SSIM, CodePrior, Perceptual, Pyramid
from kfit.fitting.schedules import Linear, Step
from kfit.generators import Template
from kfit.initializers import Constant, Previous, SphereGrid, Uniform
from kfit.optimizers import LBFGS, Adam, Stages


def picture():
    v, u = torch.meshgrid(torch.linspace(0, 5, 24), torch.linspace(0, 6, 24), indexing="ij")
    return torch.stack([0.5 + 0.3 * (u + k * v).sin() for k in (0, 1, 2)])


def pipeline(**changes):
    parts = {
        "energies": {
            "look": Pyramid(SSIM(window_size=3), num_levels=2),
            "square": L2(),
            "small": CodePrior(on="shift"),
        },
        "initializers": [Uniform("shift", -0.1, 0.3), Uniform("roll", low=-1e-7, high=0.1), Constant({"scale": 1.0})],
        "optimizer": Stages(
            [(Adam(rates={"shift": 0.02, "roll": 1 / 3, "scale": 1e-5}), 3), (LBFGS(first_step=0.01), 2)]
        ),
        "weights": {"look": Linear(1.0, 0.1), "small": 1e-4, "square": Step([1.0, 0.5], at=[0.5])},
        "rank_weights": {"square": 1.0},
        "callbacks": [Pruning({0: 4, 3: 2}), Stopping(tolerance=1e-3)],
        "num_starts": 5,
        "num_steps": 6,
        "num_candidates": 7,
        "min_overlap": 0.3,
    }
    return FitPipeline(Template(picture(), "similarity"), **parts | changes)


def read(text, folder):
    """The fit that the text describes, read as `kfit pose --fit` reads it."""
    file = folder / "fit.yaml"
    file.write_text(text, encoding="utf-8")
    parser = ArgumentParser(exit_on_error=False)
    parser.add_class_arguments(FitPipeline, skip={"generator"}, instantiate=False)
    parser.add_argument("--config", action="config")
    arguments = parser.instantiate(parser.parse_args(["--config", str(file)])).as_dict()
    arguments.pop("config")
    return FitPipeline(Template(picture(), "similarity"), **arguments)


def test_what_is_written_and_read_again_fits_bit_by_bit_alike(tmp_path):
    first = pipeline()
    second = read(first.to_yaml(), tmp_path)
    found, again = (each(Observation(picture()[None].roll(1, 2)), seed=3) for each in (first, second))
    assert torch.equal(found.all_energy, again.all_energy)
    assert torch.equal(found.history.energy.nan_to_num(), again.history.energy.nan_to_num())
    for name, value in found.values.items():
        assert torch.equal(value, again.values[name])
    assert second.to_yaml() == first.to_yaml()


def test_only_what_was_given_is_written(tmp_path):
    few = FitPipeline(
        Template(picture(), "similarity"),
        {"l2": L2()},
        [Constant({"shift": 0.0, "roll": 0.0, "scale": 1.0})],
        Adam(),
    )
    assert yaml.safe_load(few.to_yaml()) == {
        "energies": {"l2": {"class_path": "kfit.energies.L2"}},
        "initializers": [
            {
                "class_path": "kfit.initializers.Constant",
                "init_args": {"values": {"shift": 0.0, "roll": 0.0, "scale": 1.0}},
            }
        ],
        "optimizer": {"class_path": "kfit.optimizers.Adam"},
    }
    assert read(few.to_yaml(), tmp_path).num_starts == 32


def test_a_part_that_holds_a_network_or_a_result_is_refused_by_name():
    net = torch.nn.Conv2d(3, 4, 3)
    with pytest.raises(ValueError, match=r"energies.deep.network: a recipe cannot hold Conv2d"):
        pipeline(energies={"deep": Perceptual(net)}, weights=None, rank_weights=None).to_yaml()
    result = pipeline()(Observation(picture()[None]), seed=0)
    with pytest.raises(ValueError, match=r"initializers\[0\].result: a recipe cannot hold FitResult"):
        pipeline(initializers=[Previous(result)]).to_yaml()


def test_a_class_that_cannot_be_imported_is_refused():
    class Own(Energy):
        def compare(self, prediction, prepared):
            return (prediction - prepared["target"]).abs().mean((1, 2, 3))

    with pytest.raises(ValueError, match=r"energies.own: .*Own cannot be imported"):
        pipeline(energies={"own": Own()}, weights=None, rank_weights=None).to_yaml()


@pytest.mark.parametrize(
    ("part", "shown"),
    [
        (SSIM(7), "SSIM(window_size=7)"),
        (SSIM(), "SSIM(window_size=11)"),
        (CodePrior("shift"), "CodePrior(on='shift')"),
        (Uniform("roll", -1, high=1), "Uniform(on='roll', low=-1, high=1)"),
        (SphereGrid(elevation_deg=(0, 60)), "elevation_deg=[0, 60]"),
        (Adam(0.02), "Adam(rates=0.02, betas=(0.5, 0.999), decay=1.0)"),
        (Stages([(Adam(0.1), 3)]), "Stages(stages=[[Adam(rates=0.1"),
        (Pruning({0: 4}), "Pruning(keep={0: 4})"),
        (Linear(1, end=0.5), "Linear(start=1, end=0.5)"),
        (Template(picture(), "affine", fill=0.5), "picture=<Tensor>, motion='affine', fill=0.5"),
        (Perceptual(torch.nn.Conv2d(3, 4, 3), squared=False), "squared=False"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_part_shows_its_settings(part, shown):
    assert shown in repr(part)


def test_a_subclass_shows_its_own_arguments_and_not_its_base_s():
    class Half(SSIM):
        def __init__(self, share=0.5):
            super().__init__(window_size=5)
            self.share = share

    assert repr(Half(share=0.25)) == "Half(share=0.25)"
    with pytest.raises(TypeError, match="unexpected keyword argument 'sahre'"):
        Half(sahre=1)

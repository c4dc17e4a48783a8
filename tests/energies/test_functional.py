"""Functional forms, and metrics of torchmetrics made of energies."""

import inspect

import pytest
import torch
from torchmetrics import MetricCollection

import kfit.energies
from kfit.core import Energy, Prior
from kfit.energies import L1, SSIM, BendingEnergy, Pyramid, functional
from kfit.energies.mean_energy import MeanEnergy

FORMS = {
    name: form for name, form in vars(functional).items() if inspect.isfunction(form) and hasattr(form, "__signature__")
}


def pictures(rows=3):
    return list(torch.rand(2, rows, 3, 16, 16, generator=torch.Generator().manual_seed(0)))


def test_every_energy_and_prior_on_values_has_a_functional_form():
    classes = [kind for name in kfit.energies.__all__ if inspect.isclass(kind := getattr(kfit.energies, name))]
    # Three need an observation, its camera or a network; the fourth is the same number as Pyramid.
    without = {"LearnedScore", "LensPrior", "PosePrior", "ResidualPyramid"}
    named = {kind.__name__ for kind in classes if issubclass(kind, Energy | Prior)} - without
    assert {name.replace("_", "") for name in FORMS} == {name.lower() for name in named}
    assert {form.__name__ for form in FORMS.values()} == set(FORMS)


def test_a_form_is_its_class_with_settings_weight_and_reduction():
    x, y = pictures()
    weight = torch.rand(3, 1, 16, 16)
    torch.testing.assert_close(functional.ssim(x, y, weight, window_size=7), SSIM(7)(x, y, weight))
    torch.testing.assert_close(functional.l1(x, y, reduction="mean"), (x - y).abs().mean())
    torch.testing.assert_close(functional.pyramid(x, y, energy=L1(), num_levels=2), Pyramid(L1(), 2)(x, y))
    flow = torch.rand(2, 2, 8, 8)
    torch.testing.assert_close(functional.bending_energy(flow), BendingEnergy("flow")(flow))


def test_a_form_shows_the_settings_of_its_class_and_refuses_others():
    assert list(inspect.signature(functional.ssim).parameters)[-2:] == ["reduction", "window_size"]
    assert "on" not in inspect.signature(functional.code_prior).parameters
    x, y = pictures()
    with pytest.raises(TypeError, match="window"):
        functional.ssim(x, y, window=7)
    with pytest.raises(TypeError, match="target must be a tensor"):
        functional.ssim(x, y.numpy())


class TestMeanEnergy:
    def test_is_the_mean_over_all_pictures_of_all_batches(self):
        x, y = pictures(5)
        metric = MeanEnergy(SSIM(7))
        for rows in (slice(0, 1), slice(1, 5)):
            metric.update(x[rows], y[rows])
        torch.testing.assert_close(metric.compute(), SSIM(7)(x, y, reduction="mean"))
        metric.reset()
        assert metric(x, x) == pytest.approx(0, abs=1e-6)

    def test_goes_into_a_collection_with_others(self):
        x, y = pictures()
        collection = MetricCollection({"ssim": MeanEnergy(SSIM(7)), "l1": MeanEnergy(L1())})
        collection.update(x, y)
        assert set(collection.compute()) == {"ssim", "l1"}

    def test_refuses_what_is_no_energy(self):
        with pytest.raises(TypeError, match=r"energy must be a kfit.core.Energy, got Linear"):
            MeanEnergy(torch.nn.Linear(1, 1))

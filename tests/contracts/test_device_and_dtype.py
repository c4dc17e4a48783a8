"""Energies, warps and generators compute where and in what their tensors are: ``pytest --device cuda --dtype float64``.

Each is compared with itself on the CPU in double precision.
"""

import pytest
import torch
from test_energies import built, pictures, weights
from test_generators import BUILD, fields, random_values

from kfit.core import Energy

TOLERANCES = {torch.float32: {"rtol": 2e-3, "atol": 2e-4}, torch.float64: {"rtol": 1e-9, "atol": 1e-9}}


def assert_equal_there(found, expected, device, dtype):
    assert (found.device.type, found.dtype) == (device.type, dtype)
    torch.testing.assert_close(found.cpu().double(), expected, **TOLERANCES[dtype])


@pytest.mark.parametrize("kind", BUILD, ids=lambda kind: kind.__name__)
def test_a_generator_or_warp_draws_where_and_in_what_its_values_are(kind, device, dtype):
    generator = BUILD[kind][0]().double().eval()
    values = random_values(generator, 2, torch.float64)
    with torch.no_grad():
        expected = fields(generator(**values))
        drawn = fields(generator.to(device, dtype)(**{name: value.to(device, dtype) for name, value in values.items()}))
    assert drawn.keys() == expected.keys()
    for name, picture in drawn.items():
        assert_equal_there(picture, expected[name], device, dtype)


@pytest.mark.parametrize("build", built(Energy))
@pytest.mark.parametrize("weighted", [False, True], ids=["unweighted", "weighted"])
def test_an_energy_compares_where_and_in_what_its_pictures_are(build, weighted, device, dtype):
    energy = build().double()
    prediction, target = pictures(energy)
    weight = weights(energy) if weighted else None
    expected = energy(prediction, target, weight)
    there = None if weight is None else weight.to(device, dtype)
    found = energy.to(device, dtype)(prediction.to(device, dtype), target.to(device, dtype), there)
    assert_equal_there(found, expected, device, dtype)

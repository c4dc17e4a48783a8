"""Where fits compute, in which precision, compiled or not."""

import pytest
import torch
from torch import nn

from kfit.bench.held_out_views import held_out_views
from kfit.geometry import rotation_error
from kfit.geometry.pose import rotation_of
from kfit.models import load
from kfit.runtime.devices import compile_networks, device_of, precision


def test_a_device_that_is_not_there_is_named():
    with pytest.raises(ValueError, match="device: 'nonsense' cannot be used here"):
        device_of("nonsense")
    assert device_of("cpu").type == "cpu"


def test_without_a_compiler_networks_stay_as_they_are(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    network = nn.Linear(2, 2)
    assert not compile_networks(network)
    assert network._compiled_call_impl is None


def test_with_a_compiler_networks_are_compiled_on_first_use(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: "/usr/bin/" + name)
    asked = []
    monkeypatch.setattr(nn.Module, "compile", lambda module, **kwargs: asked.append((module, kwargs)))
    network = nn.Linear(2, 2)
    assert compile_networks(network, mode="reduce-overhead")
    assert asked == [(network, {"mode": "reduce-overhead"})]


@pytest.fixture(scope="module")
def mug():
    model = load("mug")
    return model, held_out_views(model, 2, seed=3).observation


@pytest.mark.filterwarnings("ignore:In CPU autocast, but the target dtype is not supported:UserWarning")
def test_a_fit_in_bfloat16_ends_where_one_in_single_precision_does(mug):
    model, observed = mug
    pipeline = model.pipeline(num_steps=8)
    single = pipeline(observed, seed=0)
    with precision("bf16", "cpu"):
        half = pipeline(observed, seed=0)
    torch.testing.assert_close(half.energy, single.energy, rtol=0.02, atol=0)  # the tolerance that README states
    assert float(rotation_error(rotation_of(half.values), rotation_of(single.values)).max().rad2deg()) < 2
    assert half.values["code"].dtype == torch.float32


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the compiler's own
def test_a_compiled_fit_ends_where_an_uncompiled_one_does(mug):
    model, observed = mug
    plain, compiled = (model.pipeline(num_starts=2, num_steps=2, callbacks=()) for _ in range(2))
    compiled.compile()
    torch.testing.assert_close(compiled(observed, seed=0).energy, plain(observed, seed=0).energy, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", ["fp16", "16-mixed", ""])
def test_a_precision_without_an_implementation_is_refused(name):
    with pytest.raises(ValueError, match=f"precision must be '32' or 'bf16', got '{name}'"):
        precision(name, "cpu")

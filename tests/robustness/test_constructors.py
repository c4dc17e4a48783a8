"""Whatever a scalar argument of a public class or function is given, it works or is refused by its name."""

import math
import sys
import warnings
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))
from builders import classes, fits, functions, scalars

WRONG = [
    math.nan, math.inf, -math.inf, -1, 0, -0.5, 2.5, 1e30, -1e30, 10**18, -(10**18), True, "x", "", b"x", None, [],
    {}, (), [math.nan], [-1, -1], (math.nan, math.nan), (math.inf,) * 3, [None] * 3, ["x", 1], [0], [10**9] * 2,
    {"code": math.nan}, {"code": "x"}, {"code": -1.0}, {"gone": 1.0}, {1: 0}, {0: math.nan}, {"shift": None},
    object(), int, 1j, np.float64("nan"), np.float32("inf"), np.zeros(2), torch.tensor(math.nan), torch.zeros(2, 2),
    OrderedDict(code=[math.nan]), "not\nlisted",
]  # fmt: skip
# Arguments that memory grows with are not asked for more of it than there is: only files are refused for that.
SIZES = {
    "channels", "code_dim", "control", "decoder_dims", "feature_dim", "hidden_dim", "image_size", "num_bins",
    "num_samples", "population", "projection_dim", "volume_dims",
}  # fmt: skip
# Either refused at once or small: a network of 10^5 channels is not to be built here.
INTEGERS = st.integers(max_value=8) | st.integers(min_value=10**8)
SCALAR = st.one_of(st.floats(), INTEGERS, st.text(max_size=3), st.none(), st.booleans())
NAMES = st.sampled_from(["code", "shift", "image", "gone"]) | st.text(max_size=2)
ANY = st.one_of(
    SCALAR,
    st.lists(SCALAR, max_size=4),
    st.lists(st.floats(-100, 100), min_size=2, max_size=3).map(tuple),
    st.lists(INTEGERS, min_size=1, max_size=3).map(tuple),
    st.dictionaries(NAMES, SCALAR, max_size=2),
)
FEW = settings(max_examples=24, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
PARTS = classes() | functions()
ASKED = [(part, name) for part, (call, _) in PARTS.items() for name in scalars(call)]
FETCHED = ("VGG16", "VGG19", "AlexNet", "LPIPS")
ENDS = (
    FileNotFoundError,
    FileExistsError,
    NotADirectoryError,
)  # files that are not there, which is not what is asked here


@pytest.fixture(autouse=True)
def offline(monkeypatch):
    """Published weights are fetched by nobody."""
    for module in ("vgg", "alexnet"):
        monkeypatch.setattr(f"kfit.features.{module}.fill_published", lambda *_: None)


def too_large(name, value):
    """Whether a size is so large that the machine, and not kfit, refuses it."""
    numbers = value if isinstance(value, list | tuple) else [value]
    return name in SIZES and any(isinstance(number, int) and number >= 10**8 for number in numbers)


def outcome(part, name, value):
    """ "works", "refused", or a sentence on what is wrong."""
    call, base = PARTS[part]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = call(**{**base, name: value})
    except (ValueError, TypeError) as error:
        message = str(error)
        if name not in message or "\n" in message:
            return f"unnamed: {type(error).__name__}: {message}"
        return "refused"
    except ENDS:
        made = None
    except Exception as error:
        return f"crash: {type(error).__name__}: {error}"
    if not fits(scalars(call)[name], value):
        return "silent"
    held = [v for v in vars(made).values() if isinstance(v, float)] if hasattr(made, "__dict__") else []
    return "works" if all(map(math.isfinite, held)) else f"silent: it holds {held}"


def test_all_that_is_public_is_asked():
    asked = {part for part, _ in ASKED}
    assert len(ASKED) > 150
    assert asked >= {
        "SSIM",
        "Adam",
        "SphereGrid",
        "VAE3D",
        "FitPipeline",
        "ViewsDataModule",
        "DatasetFit",
        "build_views",
    }


@pytest.mark.parametrize("part", PARTS)
def test_what_is_usual_works(part):
    call, base = PARTS[part]
    try:
        call(**base)
    except ENDS:
        assert part == "build_views"


@pytest.mark.slow
@pytest.mark.parametrize(("part", "name"), ASKED, ids=[f"{part}.{name}" for part, name in ASKED])
def test_a_wrong_argument_is_refused_by_its_name(part, name):
    if part in FETCHED and name == "weights":
        pytest.skip("what a file of weights is, is not asked without one")
    asked = [value for value in WRONG if not too_large(name, value)]
    bad = {repr(value): found for value in asked if (found := outcome(part, name, value)) not in ("works", "refused")}
    assert not bad

    @FEW
    @given(ANY)
    def whatever(value):
        assert too_large(name, value) or outcome(part, name, value) in ("works", "refused")

    whatever()

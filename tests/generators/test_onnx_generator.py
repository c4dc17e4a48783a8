"""A generator in an ONNX file, here a hand-made one: a disc of one colour whose middle moves."""

import json

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from kfit.core import Angle, Positive, Real, Variable, frozen
from kfit.generators import OnnxGenerator, SimilarityWarp

SIDE = 8
DESCRIPTION = {
    "place": {"shape": [2], "space": "Real", "settings": {}},
    "size": {"shape": [], "space": "Positive", "settings": {}},
}


def write(path, description=DESCRIPTION, outputs=("image", "mask")):
    """mask = exp(−‖pixel − place‖² / size), image = 1 − mask · (0, 0.5, 1)."""
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, SIDE)] * 2), 0)[None].astype(np.float32)
    constants = {
        "grid": grid,
        "ink_color": np.array([0, 0.5, 1], np.float32).reshape(1, 3, 1, 1),
        "one": np.ones(1, np.float32),
        "pair": np.array([-1, 2, 1, 1]),
        "single": np.array([-1, 1, 1, 1]),
        "axis": np.array([1]),
    }
    nodes = [
        helper.make_node("Reshape", ["place", "pair"], ["middle"]),
        helper.make_node("Reshape", ["size", "single"], ["width"]),
        helper.make_node("Sub", ["grid", "middle"], ["away"]),
        helper.make_node("ReduceSumSquare", ["away", "axis"], ["square"]),
        helper.make_node("Div", ["square", "width"], ["share"]),
        helper.make_node("Neg", ["share"], ["minus"]),
        helper.make_node("Exp", ["minus"], [outputs[1]]),
        helper.make_node("Mul", [outputs[1], "ink_color"], ["ink"]),
        helper.make_node("Sub", ["one", "ink"], [outputs[0]]),
    ]
    graph = helper.make_graph(
        nodes,
        "disc",
        [
            helper.make_tensor_value_info("place", TensorProto.FLOAT, ["rows", 2]),
            helper.make_tensor_value_info("size", TensorProto.FLOAT, ["rows"]),
        ],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in outputs],
        [numpy_helper.from_array(array, name) for name, array in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    if description is not None:
        helper.set_model_props(model, {"kfit_variables": json.dumps(description)})
    onnx.save(model, path)
    return path


@pytest.fixture
def disc(tmp_path):
    return OnnxGenerator(write(tmp_path / "disc.onnx"))


def values(rows, dtype=torch.float32):
    place = torch.linspace(-0.5, 0.5, 2 * rows, dtype=dtype).view(rows, 2)
    return {"place": place, "size": torch.linspace(0.2, 0.4, rows, dtype=dtype)}


def expected(place, size):
    axis = torch.linspace(-1, 1, SIDE, dtype=place.dtype)
    away = (axis - place[:, :1]).square()[:, None] + (axis - place[:, 1:]).square()[:, :, None]
    mask = (-away / size[:, None, None]).exp()[:, None]
    return 1 - mask * torch.tensor([0.0, 0.5, 1.0]).view(1, 3, 1, 1), mask


@pytest.mark.parametrize("rows", [1, 3, 5])
def test_draws_what_the_file_says_for_any_number_of_rows(disc, rows):
    drawn = disc(**values(rows))
    image, mask = expected(**values(rows))
    torch.testing.assert_close(drawn.image, image)
    torch.testing.assert_close(drawn.mask, mask)
    assert drawn.depth is None


def test_the_file_tells_the_variables_and_their_spaces(disc):
    assert disc.variables == {"place": Variable((2,), Real()), "size": Variable((), Positive())}


def test_draws_in_the_type_of_the_values(disc):
    assert disc(**values(2, torch.float64)).image.dtype == torch.float64


def test_can_be_frozen_bound_and_warped(disc):
    inputs = values(3)
    bound = frozen(SimilarityWarp(disc)).bind(size=inputs["size"][1], scale=torch.tensor(1.0))
    drawn = bound(place=inputs["place"], roll=torch.zeros(3), shift=torch.zeros(3, 2))
    image, _ = expected(inputs["place"], inputs["size"][1].expand(3))
    torch.testing.assert_close(drawn.image, image)


def test_refuses_to_give_gradients_rather_than_give_wrong_ones(disc):
    inputs = values(2)
    inputs["size"].requires_grad_()
    with pytest.raises(RuntimeError, match="has no gradients: fit it with an optimizer that needs none"):
        disc(**inputs)
    with torch.no_grad():
        disc(**inputs)


def test_refuses_wrong_names_and_shapes_in_a_sentence(disc):
    with pytest.raises(ValueError, match="nothing for size; the names are place, size"):
        disc(place=torch.zeros(2, 2))
    with pytest.raises(ValueError, match=r"place must have shape \(N, 2\), got \(2, 3\)"):
        disc(place=torch.zeros(2, 3), size=torch.ones(2))


def test_another_file_gets_one_sentence(tmp_path):
    with pytest.raises(FileNotFoundError, match="no ONNX file at"):
        OnnxGenerator(tmp_path / "nothing.onnx")
    (tmp_path / "text.onnx").write_text("no model")
    strange = {"place": DESCRIPTION["place"] | {"space": "Sphere"}, "size": DESCRIPTION["size"]}
    for path in (
        tmp_path / "text.onnx",
        write(tmp_path / "plain.onnx", description=None),
        write(tmp_path / "strange.onnx", description=strange),
    ):
        with pytest.raises(ValueError, match=f"{path.name} is no generator that `kfit export` wrote") as raised:
            OnnxGenerator(path)
        assert "\n" not in str(raised.value)
    with pytest.raises(ValueError, match="must draw image, mask, depth, weight, image first; it draws color, mask"):
        OnnxGenerator(write(tmp_path / "other.onnx", outputs=("color", "mask")))


def test_angles_and_bounds_are_in_the_file_too(tmp_path):
    description = {
        "place": {"shape": [2], "space": "Bounded", "settings": {"low": -1.0, "high": 2.0}},
        "size": DESCRIPTION["size"] | {"space": "Angle"},
    }
    variables = OnnxGenerator(write(tmp_path / "described.onnx", description)).variables
    assert variables["size"].space == Angle()
    assert variables["place"].space.to_value(torch.tensor(0.0)) == 0.5

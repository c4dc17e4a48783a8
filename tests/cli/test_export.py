"""``kfit export``: what ONNX Runtime draws, encodes and sees is what PyTorch does, and can be fitted through."""

from __future__ import annotations

import builtins
from pathlib import Path

import onnxruntime
import pytest
import torch
from tiny_model import write_tiny
from torch import Tensor

import kfit
from kfit.cli.main import main
from kfit.core import Generator, Observation, Rendering, Space, Variable
from kfit.energies import L2, Silhouette
from kfit.features import EfficientNetLite0
from kfit.generators import OnnxGenerator, SimilarityWarp
from kfit.initializers import Constant
from kfit.models.export import export_generator
from kfit.optimizers import CMAES, Adam
from kfit.pose import CategoryModel

ROWS = [1, 2, 5]


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[CategoryModel, Path]:
    """A model of random weights and the folder that the command wrote."""
    home = tmp_path_factory.mktemp("export")
    write_tiny(home / "tiny.safetensors")
    main(["export", str(home / "tiny.safetensors"), "--out", str(home / "onnx")])
    return kfit.load(home / "tiny.safetensors"), home / "onnx"


def run(path: Path, **args: Tensor) -> list[Tensor]:
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    return [torch.from_numpy(a) for a in session.run(None, {name: value.numpy() for name, value in args.items()})]


def pose(rows: int, code_dim: int) -> dict[str, Tensor]:
    return {"code": torch.randn(rows, code_dim), "azimuth": 3 * torch.randn(rows), "elevation": torch.randn(rows)}


def close(found: Tensor, expected: Tensor) -> None:
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.slow
def test_three_files_are_written_and_nothing_else(exported: tuple[CategoryModel, Path]) -> None:
    assert sorted(path.name for path in exported[1].iterdir()) == ["encoder.onnx", "features.onnx", "generator.onnx"]


@pytest.mark.slow
@pytest.mark.parametrize("rows", ROWS)
def test_the_generator_in_onnx_draws_what_pytorch_draws(exported: tuple[CategoryModel, Path], rows: int) -> None:
    model, folder = exported
    generator = OnnxGenerator(folder / "generator.onnx")
    assert generator.variables == model.generator.variables
    inputs = pose(rows, 4)
    with torch.no_grad():
        found, expected = generator(**inputs), model.generator(**inputs)
    close(found.field("image"), expected.field("image"))
    close(found.field("mask"), expected.field("mask"))


@pytest.mark.slow
@pytest.mark.parametrize("rows", ROWS)
def test_encoder_and_features_in_onnx_give_what_pytorch_gives(exported: tuple[CategoryModel, Path], rows: int) -> None:
    model, folder = exported
    image = torch.rand(rows, 3, 64, 64)
    with torch.no_grad():
        code, observed = model.encoder(image), EfficientNetLite0()(image)
    for found, expected in zip(run(folder / "encoder.onnx", image=image), code, strict=True):
        close(found, expected)
    for found, expected in zip(run(folder / "features.onnx", image=image), observed.values(), strict=True):
        close(found, expected)


@pytest.mark.slow
def test_cma_es_fits_through_the_onnx_generator_alone(exported: tuple[CategoryModel, Path]) -> None:
    model, folder = exported
    generator = SimilarityWarp(OnnxGenerator(folder / "generator.onnx"))
    truth = {"shift": torch.tensor([[0.2, -0.1]]), "roll": torch.tensor([0.3]), "scale": torch.tensor([0.8])}
    inputs = pose(1, 4)
    with torch.no_grad():
        observed = SimilarityWarp(model.generator)(**inputs, **truth)
    held = generator.bind(**{name: value[0] for name, value in inputs.items()})
    pipeline = kfit.FitPipeline(
        held,
        {"image": L2(), "mask": Silhouette()},
        [Constant({"roll": 0.0, "shift": 0.0, "scale": 1.0})],
        CMAES(0.1, population=12),
        num_starts=1,
        num_steps=40,
    )
    found = pipeline(Observation(observed.field("image"), observed.mask), seed=0).values
    for name, value in truth.items():
        torch.testing.assert_close(found[name], value, rtol=0, atol=0.02)


@pytest.mark.slow
def test_a_descent_through_the_onnx_generator_is_refused_in_a_sentence(exported: tuple[CategoryModel, Path]) -> None:
    _, folder = exported
    pipeline = kfit.FitPipeline(
        OnnxGenerator(folder / "generator.onnx"),
        {"image": L2()},
        [Constant({"code": 0.0, "azimuth": 0.0, "elevation": 0.0})],
        Adam({"code": 0.1, "azimuth": 0.1, "elevation": 0.1}),
        num_starts=1,
    )
    with pytest.raises(RuntimeError, match="has no gradients: fit it with an optimizer that needs none"):
        pipeline(Observation(torch.rand(1, 3, 64, 64)))


@pytest.mark.slow
def test_a_bundled_model_is_exported_whole_and_its_warp_with_it(tmp_path: Path) -> None:
    model = kfit.load("mug")
    main(["export", "mug", "--out", str(tmp_path)])
    export_generator(SimilarityWarp(model.generator), tmp_path / "warped.onnx")
    inputs = pose(7, 16) | {"focal": 2 + torch.rand(7)}
    image = torch.rand(7, 3, 64, 64)
    rotated = {"roll": torch.randn(7), "shift": 0.2 * torch.randn(7, 2), "scale": 0.8 + 0.4 * torch.rand(7)}
    model.generator.train()  # looks at the whole box, as what is exported does
    with torch.no_grad():
        close(OnnxGenerator(tmp_path / "generator.onnx")(**inputs).image, model.generator(**inputs).image)
        expected = SimilarityWarp(model.generator)(**inputs, **rotated)
        close(OnnxGenerator(tmp_path / "warped.onnx")(**inputs, **rotated).image, expected.image)
        for found, mean in zip(run(tmp_path / "encoder.onnx", image=image), model.encoder(image), strict=True):
            close(found, mean)


class Cube(Space):
    """A space of somebody else's."""

    def to_value(self, raw: Tensor) -> Tensor:
        return raw**3

    def to_raw(self, value: Tensor) -> Tensor:
        return value.sign() * value.abs() ** (1 / 3)


class Grey(Generator):
    def __init__(self) -> None:
        super().__init__()
        self.variables = {"grey": Variable((), Cube())}

    def forward(self, **values: Tensor) -> Rendering:
        return Rendering(values["grey"].view(-1, 1, 1, 1).expand(-1, 3, 32, 32))


def test_a_space_that_a_file_cannot_tell_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'grey' lives in the space Cube, which ONNX files cannot store"):
        export_generator(Grey(), tmp_path / "grey.onnx")


def test_without_the_exporter_s_package_the_command_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name == "onnxscript":
            raise ImportError(name)
        return real(name, *args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(SystemExit):
        main(["export", "mug", "--out", str(tmp_path / "out")])
    assert "needs the package onnxscript: pip install 'kfit[export]'" in capsys.readouterr().err


def test_an_unknown_model_gets_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["export", "teapot", "--out", str(tmp_path / "out")])
    assert "those known are" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()

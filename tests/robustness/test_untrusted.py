"""Files from strangers: whatever they are called, nothing in them is run, and nothing outside them is read."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch

from kfit.cli.main import main
from kfit.data import load_pickle
from kfit.data.mesh_files import load_mesh
from kfit.data.views import Views
from kfit.features import VGG16
from kfit.generators import OnnxGenerator
from kfit.models import load
from kfit.models.released import load_released
from kfit.pose.fit_recipe import fit_of
from kfit.pose.model_files import read_checkpoint
from kfit.segmentation import depth_from_file, load_segmenter, mask_from_file, read_photo

READERS: dict[str, Callable[[Path], Any]] = {
    ".safetensors": load,
    ".ckpt": read_checkpoint,
    ".pth": lambda path: VGG16(weights=str(path)),
    ".pt": load_released,
    ".onnx": load_segmenter,
    ".pkl": load_pickle,
    ".h5": Views,
    ".npy": lambda path: depth_from_file(path, (4, 4)),
    ".png": read_photo,
    ".jpg": read_photo,
    ".tif": lambda path: mask_from_file(path, (4, 4)),
    ".webp": read_photo,
    ".obj": load_mesh,
    ".glb": load_mesh,
    ".ply": load_mesh,
    ".yaml": lambda path: fit_of(path, load("mug")),
    "_generator.onnx": OnnxGenerator,
}


class Runs:
    """Touches a file when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.mark,)


@pytest.fixture
def mark(tmp_path: Path) -> Path:
    return tmp_path / "executed"


def test_the_trap_works(tmp_path: Path, mark: Path) -> None:
    pickle.loads(pickle.dumps(Runs(mark)))
    assert mark.exists()


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("ending", READERS)
@pytest.mark.parametrize("how", ["pickle", "old pickle", "torch"])
def test_a_pickle_under_another_name_executes_nothing(ending: str, how: str, tmp_path: Path, mark: Path) -> None:
    path = tmp_path / f"file{ending}"
    if how == "torch":
        torch.save({"state_dict": Runs(mark), "hyper_parameters": Runs(mark)}, path)
    else:
        path.write_bytes(pickle.dumps(Runs(mark), protocol=0 if how == "old pickle" else 4))
    if ending == ".safetensors":  # with a card as version 0.1 kept it, so that the weights are looked at
        path.with_suffix(".json").write_text(load("mug").card.to_json())
    with pytest.raises((ValueError, TypeError, OSError)) as error:
        READERS[ending](path)
    assert len(str(error.value).splitlines()) == 1
    assert not mark.exists()


@pytest.mark.filterwarnings("ignore:LightningCLI's args parameter")
def test_a_recipe_s_python_tags_execute_nothing(tmp_path: Path, mark: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recipe = tmp_path / "fit.yaml"
    for tag in ("!!python/object/apply:os.mkdir", "!!python/object/new:os.mkdir", "!!python/name:os.mkdir"):
        recipe.write_text(f"num_starts: {tag} ['{mark}']\n")
        with pytest.raises(ValueError, match="recipe"):
            fit_of(recipe, load("mug"))
        with pytest.raises(SystemExit):
            main(["fit", "-c", str(recipe)])
        assert "Traceback" not in capsys.readouterr().err
        assert not mark.exists()


def test_links_of_an_hdf5_file_are_not_followed(tmp_path: Path) -> None:
    pictures, poses = np.zeros((2, 8, 8, 3), np.uint8), np.zeros((2, 2), np.float32)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["images"], file["poses"] = pictures, poses
    (tmp_path / "raw.bin").write_bytes(pictures.tobytes())
    layout = h5py.VirtualLayout(shape=pictures.shape, dtype=np.uint8)
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "images", shape=pictures.shape)
    outside: dict[str, Callable[[h5py.File], object]] = {
        "external link": lambda file: file.__setitem__(
            "images", h5py.ExternalLink(str(tmp_path / "other.h5"), "images")
        ),
        "soft link": lambda file: file.__setitem__("images", h5py.SoftLink("/poses")),
        "external storage": lambda file: file.create_dataset(
            "images", pictures.shape, np.uint8, external=[(str(tmp_path / "raw.bin"), 0, pictures.nbytes)]
        ),
        "virtual": lambda file: file.create_virtual_dataset("images", layout),
        "group": lambda file: file.create_group("images"),
    }
    for name, write in outside.items():
        with h5py.File(tmp_path / "file.h5", "w") as file:
            write(file)
            file["poses"] = poses
        with pytest.raises(ValueError, match="images itself"):
            Views(tmp_path / "file.h5", 2)
        assert name


def test_sizes_are_looked_at_before_anything_is_allocated(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "huge.h5", "w") as file:
        file.create_dataset("images", (1 << 30, 64, 64, 3), np.uint8, chunks=(1, 64, 64, 3))
        file.create_dataset("poses", (1 << 30, 2), np.float32, chunks=(1, 2))
    assert (tmp_path / "huge.h5").stat().st_size < 100_000
    with pytest.raises(ValueError, match="images must fit into memory, but takes 13,194 GB"):
        Views(tmp_path / "huge.h5", 2)
    header = np.lib.format.header_data_from_array_1_0(np.zeros((1, 1), np.float32)) | {"shape": (1 << 20, 1 << 20)}
    with (tmp_path / "huge.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(ValueError, match="damaged"):
        depth_from_file(tmp_path / "huge.npy", (1 << 20, 1 << 20))
    (tmp_path / "large.obj").touch()
    os.truncate(tmp_path / "large.obj", 3 * 1024**3)  # takes no room
    with pytest.raises(ValueError, match="at most 2 GB"):
        load_mesh(tmp_path / "large.obj")


@pytest.mark.parametrize("name", ["../secret.png", "{folder}/secret.png"])
def test_a_material_reads_no_picture_outside_its_folder(name: str, tmp_path: Path) -> None:
    from PIL import Image

    (tmp_path / "mesh").mkdir()
    Image.new("RGB", (8, 8), (255, 0, 0)).save(tmp_path / "secret.png")
    Image.new("RGB", (8, 8), (0, 255, 0)).save(tmp_path / "mesh/own.png")
    for picture, red in ((name.format(folder=tmp_path), False), ("own.png", False)):
        (tmp_path / "mesh/m.mtl").write_text(f"newmtl a\nmap_Kd {picture}\n")
        (tmp_path / "mesh/m.obj").write_text(
            "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
        )
        texture = load_mesh(tmp_path / "mesh/m.obj").texture
        assert bool((texture[..., 0] > texture[..., 1]).any()) is red
    assert (texture[..., 1] > texture[..., 0]).any()  # its own picture was read


def test_an_onnx_file_reads_no_weights_outside_its_folder(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    (tmp_path / "model").mkdir()
    np.arange(4, dtype=np.float32).tofile(tmp_path / "secret.bin")
    for where in ("../secret.bin", str(tmp_path / "secret.bin")):
        weights = onnx.helper.make_tensor("w", onnx.TensorProto.FLOAT, [4], b"\0" * 16, raw=True)
        weights.ClearField("raw_data")
        weights.data_location = onnx.TensorProto.EXTERNAL
        for key, value in (("location", where), ("offset", "0"), ("length", "16")):
            entry = weights.external_data.add()
            entry.key, entry.value = key, value
        ends = [onnx.helper.make_tensor_value_info(end, onnx.TensorProto.FLOAT, [4]) for end in ("x", "y")]
        graph = onnx.helper.make_graph(
            [onnx.helper.make_node("Add", ["x", "w"], ["y"])], "g", ends[:1], ends[1:], [weights]
        )
        model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)])
        model.ir_version = 9
        (tmp_path / "model/m.onnx").write_bytes(model.SerializeToString())
        for read in (load_segmenter, OnnxGenerator):
            with pytest.raises(ValueError, match=r"m\.onnx is no .*[Ee]xternal data path"):
                read(tmp_path / "model/m.onnx")

"""Words that tell where meshes lie and how they stand, and the formats that people have."""

import logging

import numpy as np
import pytest
import trimesh

from kfit.data import ViewsDataModule
from kfit.data.mesh_files import find_meshes, load_mesh
from kfit.data.mesh_places import AXES, MeshFile, find_mesh_files, source_identity


def write(path, front=(5, 0, 0), up=(0, 2, 0)):
    """A box with a far point along its front and a nearer one along its up."""
    path.parent.mkdir(parents=True, exist_ok=True)
    box = trimesh.creation.box((1, 1, 1))
    ends = [trimesh.creation.icosphere(0, 0.01).apply_translation(place) for place in (front, up)]
    mesh = trimesh.util.concatenate([box, *ends])
    if path.suffix == ".gltf":  # trimesh's own writing to a path leaves files open
        for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
            (path if name == "model.gltf" else path.parent / name).write_bytes(content)
    else:
        mesh.export(path)
    return path


@pytest.mark.parametrize("suffix", ["obj", "glb", "gltf", "ply", "stl"])
def test_meshes_load_in_the_formats_that_people_have(tmp_path, suffix):
    mesh = load_mesh(write(tmp_path / f"a.{suffix}"))
    assert mesh.bounds[1][0] == pytest.approx(5.01, abs=0.01)
    assert len(find_meshes(tmp_path)) == 1


@pytest.mark.parametrize("up", list(AXES))
@pytest.mark.parametrize("front", list(AXES))
def test_up_comes_to_plus_y_and_the_front_to_plus_x_without_a_mirror(tmp_path, up, front):
    if up[-1] == front[-1]:
        with pytest.raises(ValueError, match="must be different axes"):
            find_mesh_files(f"{tmp_path}@{up},{front}")
        return
    path = write(tmp_path / "m.ply", 5 * np.array(AXES[front]), 2 * np.array(AXES[up]))
    (file,) = find_mesh_files(f"{path}@{up},{front}")
    low, high = file.mesh().bounds
    assert high[0] - low[0] > high[1] - low[1] > high[2] - low[2]
    assert np.linalg.det(file.rotation) == pytest.approx(1)
    np.testing.assert_allclose(file.rotation @ AXES[front], (1, 0, 0))
    np.testing.assert_allclose(file.rotation @ AXES[up], (0, 1, 0))


def test_the_last_place_that_tells_how_a_file_stands_counts(tmp_path):
    for name in ("a", "odd"):
        write(tmp_path / "pots" / f"{name}.stl")
    files = find_mesh_files([f"teapot={tmp_path}/pots@y,-z", f"{tmp_path}/pots/odd.stl@z", str(tmp_path)], ["teapot"])
    assert {(f.path.stem, f.category, f.up, f.front) for f in files} == {
        ("a", "teapot", "y", "-z"),
        ("odd", "teapot", "z", "x"),
    }


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("pots@w", "says that 'w' is up"),
        ("pots@y,w", "says that 'w' is the front"),
        ("mugs=pots", "names category 'mugs'; those known are teapot"),
        ("nowhere@z", "meshes must name files or folders of meshes, but there is no nowhere$"),
    ],
)
def test_places_that_cannot_be_get_a_sentence(tmp_path, monkeypatch, place, message):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "pots" / "a.stl")
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        find_mesh_files(place, ["teapot"])


def test_another_stand_is_another_object_and_y_up_keeps_older_caches(tmp_path):
    path = write(tmp_path / "a.ply")
    (plain,) = source_identity([MeshFile(path)])
    (rotated,) = source_identity([MeshFile(path, up="z")])
    assert rotated == f"{plain} @z,x"
    assert "@" not in plain


def test_files_that_are_not_read_are_listed(tmp_path, caplog):
    write(tmp_path / "a.ply")
    (tmp_path / "b.fbx").write_text("x")
    (tmp_path / "c.blend").write_text("x")
    with caplog.at_level(logging.WARNING, "kfit"):
        (found,) = find_mesh_files(str(tmp_path))
        assert found.name == tmp_path.name
    assert caplog.text.count("not read: b.fbx, c.blend") == 1


def test_a_training_lists_once_what_is_not_read(tmp_path, caplog):
    write(tmp_path / "pots" / "a.ply")
    (tmp_path / "pots" / "b.fbx").write_text("x")
    data = ViewsDataModule("mug", 1, 2, 8, meshes=[str(tmp_path / "pots")], cache_dir=str(tmp_path), num_val_objects=1)
    with caplog.at_level(logging.WARNING, "kfit"):
        data.prepare_data()
        data.setup()
        data.fingerprint()
    assert caplog.text.count("not read: b.fbx") == 1


def test_a_texture_that_is_lost_is_named(tmp_path, caplog):
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd gone.png\n")
    with caplog.at_level(logging.WARNING, "kfit"):
        load_mesh(tmp_path / "a.obj")
    assert "gone.png" in caplog.text

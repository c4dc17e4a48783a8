"""The fitted object's surface, in memory and as a file."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from fitted import fitted_mug

from kfit.cli.main import main
from kfit.reports.mesh_file import check_mesh_suffix, write_mesh


def test_an_answer_s_mesh_is_closed_coloured_and_in_metres():
    result = fitted_mug()
    mesh = result.mesh()
    assert mesh.is_watertight
    assert mesh.extents == pytest.approx(result.size, rel=0.25)
    assert np.abs(mesh.bounds.mean(0)).max() < 0.2 * result.size.max()
    assert mesh.visual.vertex_colors.std() > 5


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply"])
def test_files_hold_the_mesh_that_the_answer_has(tmp_path, suffix):
    result = fitted_mug()
    write_mesh(result, tmp_path / f"new/mug{suffix}")
    read = trimesh.load(tmp_path / f"new/mug{suffix}", force="mesh", process=False)
    mesh = result.mesh()
    assert len(read.faces) == len(mesh.faces)
    assert read.extents == pytest.approx(mesh.extents, abs=1e-5)
    found = np.asarray(read.visual.vertex_colors)[:, :3] / 255
    colors = np.asarray(mesh.visual.vertex_colors)[:, :3] / 255
    expected = ((colors + 0.055) / 1.055) ** 2.4 if suffix == ".glb" else colors  # linear light in glTF
    assert found.mean(0) == pytest.approx(expected.mean(0), abs=0.03)


def test_a_model_without_a_volume_has_no_mesh():
    with pytest.raises(ValueError, match="the model of mug draws without a volume"):
        replace(fitted_mug(), surface=None).mesh()


def test_other_kinds_of_files_are_refused_before_a_fit(tmp_path, capsys):
    with pytest.raises(ValueError, match=r"mesh must be a \.glb, \.obj or \.ply file, got 'mug.stl'"):
        check_mesh_suffix("mug.stl")
    photo = tmp_path / "photo.png"
    from skimage.io import imsave

    imsave(photo, np.zeros((8, 8, 3), np.uint8), check_contrast=False)
    with pytest.raises(SystemExit):
        main(["pose", str(photo), "--category", "mug", "--box", "1", "1", "5", "5", "--mesh", str(tmp_path / "m.stl")])
    assert "mesh must be a .glb, .obj or .ply file" in capsys.readouterr().err

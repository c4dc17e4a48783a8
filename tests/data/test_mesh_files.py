"""Meshes from disk, written by the tests themselves."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from kfit.data.light import Light
from kfit.data.mesh_files import find_meshes, load_mesh
from kfit.data.rasterizer import pose_view

EVEN = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))
OBJ = """mtllib two.mtl
v -0.5 -0.5 0
v 0.5 -0.5 0
v 0.5 0.5 0
v -0.5 0.5 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl painted
f 1/1 2/2 3/3
usemtl plain
f 1/1 3/3 4/4
"""
MTL = "newmtl painted\nKd 1 1 1\nmap_Kd picture.png\nnewmtl plain\nKd 0 0 1\n"


@pytest.fixture
def two_materials(tmp_path):
    """A square of two triangles: the lower right one shows a picture, the upper left one is blue."""
    picture = np.zeros((16, 16, 3), np.uint8)
    picture[8:] = (255, 0, 0)
    picture[:8] = (0, 255, 0)
    Image.fromarray(picture).save(tmp_path / "picture.png")
    (tmp_path / "two.mtl").write_text(MTL)
    (tmp_path / "two.obj").write_text(OBJ)
    return tmp_path / "two.obj"


def test_obj_keeps_the_picture_of_one_material_and_the_colour_of_another(two_materials):
    image = pose_view(load_mesh(two_materials), 0, 0, EVEN).image
    np.testing.assert_allclose(image[50, 38], (1, 0, 0), atol=0.02)
    np.testing.assert_allclose(image[22, 55], (0, 1, 0), atol=0.02)
    np.testing.assert_allclose(image[20, 12], (0, 0, 1), atol=0.02)


def test_glb_keeps_the_picture(two_materials, tmp_path):
    trimesh.load_scene(two_materials).export(tmp_path / "two.glb")
    image = pose_view(load_mesh(tmp_path / "two.glb"), 0, 0, EVEN).image
    np.testing.assert_allclose(image[50, 38], (1, 0, 0), atol=0.02)
    np.testing.assert_allclose(image[22, 55], (0, 1, 0), atol=0.02)


def test_ply_keeps_vertex_colours_and_sharp_edges(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    box.visual.vertex_colors = np.tile([10, 200, 30, 255], (len(box.vertices), 1))
    box.export(tmp_path / "box.ply")
    mesh = load_mesh(tmp_path / "box.ply")
    np.testing.assert_allclose(mesh.extents, np.array([1, 2, 3]) / np.sqrt(14), atol=1e-5)
    view = pose_view(mesh.normalised(), 0, 0, EVEN)
    np.testing.assert_allclose(view.image[32, 32] * 255, (10, 200, 30), atol=1.5)


def test_repeating_texture_coordinates_repeat_the_picture(two_materials):
    two_materials.write_text(OBJ.replace("vt 1 0", "vt 2 0").replace("vt 1 1", "vt 2 2").replace("vt 0 1", "vt 0 2"))
    image = pose_view(load_mesh(two_materials), 0, 0, EVEN).image
    rows = image[:, 58, 0] > 0.5
    green = image[:, 58, 1] > 0.5
    assert np.count_nonzero(np.diff((rows & ~green).astype(int)) == 1) == 2


def test_undefined_texture_coordinates_and_missing_normals_do_no_harm(two_materials):
    two_materials.write_text(OBJ.replace("vt 1 1", "vt nan nan"))
    assert np.isfinite(load_mesh(two_materials).uv).all()


def test_normals_are_smooth_across_vertices_that_a_file_splits(tmp_path):
    ball = trimesh.creation.icosphere(3)
    soup = trimesh.Trimesh(ball.triangles.reshape(-1, 3), np.arange(3 * len(ball.faces)).reshape(-1, 3), process=False)
    soup.export(tmp_path / "ball.ply")
    mesh = load_mesh(tmp_path / "ball.ply")
    np.testing.assert_allclose(mesh.normals, mesh.vertices, atol=0.02)


def test_folders_in_the_layouts_of_nocs_and_shapenet_are_searched(tmp_path, two_materials):
    for place in ("set/b/model.obj", "set/a/models/model_normalized.obj", "set/a/textures/notes.txt"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text(OBJ)
    names = [str(file.relative_to(tmp_path)) for file in find_meshes(tmp_path / "set")]
    assert names == ["set/a/models/model_normalized.obj", "set/b/model.obj"]


def test_a_folder_of_single_files_is_searched_too(tmp_path, two_materials):
    assert find_meshes(tmp_path) == [two_materials]


def test_missing_empty_and_foreign_files_are_refused_in_one_sentence(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load_mesh(tmp_path / "none.obj")
    (tmp_path / "text.txt").write_text("no mesh")
    with pytest.raises(ValueError, match="must end in"):
        load_mesh(tmp_path / "text.txt")
    (tmp_path / "text.stl").write_text("no mesh")
    with pytest.raises(ValueError, match="must hold triangles"):
        load_mesh(tmp_path / "text.stl")
    (tmp_path / "broken.glb").write_bytes(b"glTF but not really")
    with pytest.raises(ValueError, match=r"broken\.glb"):
        load_mesh(tmp_path / "broken.glb")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    with pytest.raises(ValueError, match=r"points\.obj"):
        load_mesh(tmp_path / "points.obj")
    with pytest.raises(FileNotFoundError, match="existing folder"):
        find_meshes(tmp_path / "nowhere")
    (tmp_path / "bare").mkdir()
    with pytest.raises(ValueError, match="holds none"):
        find_meshes(tmp_path / "bare")

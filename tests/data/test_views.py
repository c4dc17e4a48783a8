"""Files of views: their layout, their reuse and resumption, and files by others."""

import h5py
import numpy as np
import pytest

from kfit.data import drawn_objects, view_parts
from kfit.data.mesh_places import find_mesh_files
from kfit.data.rasterizer import pose_view
from kfit.data.rendered_views import build_views
from kfit.data.shapes import build
from kfit.data.view_parts import ViewParts
from kfit.data.views import Views


def contents(path):
    with h5py.File(path) as file:
        return {name: file[name][()] for name in ("images", "poses", "distances", "depth", "extents")}


def test_the_layout_is_the_released_one_with_depth_and_extents_beside_it(tmp_path):
    path = build_views(tmp_path / "mugs.h5", "mug", 2, 3, image_size=32, elevation_deg=(10, 40), upright=1)
    data = contents(path)
    assert {name: (array.shape, array.dtype.name) for name, array in data.items()} == {
        "images": ((6, 32, 32, 4), "uint8"),
        "poses": ((6, 2), "float32"),
        "distances": ((6,), "float32"),
        "depth": ((6, 32, 32), "float16"),
        "extents": ((2, 3), "float32"),
    }
    assert ((data["poses"] >= (10, 0)) & (data["poses"] <= (40, 360))).all()
    assert (data["images"][..., :3][data["images"][..., 3] == 0] == 255).all()
    assert not data["depth"][data["images"][..., 3] == 0].any()
    assert np.abs(data["depth"]).max() < 0.52
    np.testing.assert_allclose(np.linalg.norm(data["extents"], axis=1), 1, atol=1e-5)


def test_a_row_is_the_picture_of_its_pose(tmp_path):
    data = contents(build_views(tmp_path / "cans.h5", "can", 2, 2, image_size=32))
    mesh, light = build("can", 1)
    (elevation, azimuth), distance = np.deg2rad(data["poses"][3]), float(data["distances"][3])
    view = pose_view(mesh, elevation, azimuth, light, 32, distance)
    np.testing.assert_allclose(data["images"][3, ..., :3] / 255, view.image, atol=0.03)
    inside = view.mask == 1
    np.testing.assert_allclose(data["depth"][3][inside], view.depth[inside] - distance, atol=2e-3)


@pytest.mark.slow
def test_distances_and_elevations_follow_their_stated_distributions(tmp_path):
    settings = {"image_size": 2, "supersample": 1, "elevation_deg": (20, 30)}
    data = contents(build_views(tmp_path / "bowls.h5", "bowl", 1, 600, **settings))
    distances, elevations = data["distances"], data["poses"][:, 0]
    assert distances.min() >= 1.3
    assert distances.max() <= 8
    # Half of a log-uniform distribution lies below the geometric mean of its ends.
    assert (distances < np.sqrt(1.3 * 8)).mean() == pytest.approx(0.5, abs=0.05)
    upright = (elevations >= 20) & (elevations <= 30)
    on_sphere = (np.sin(np.deg2rad(30)) - np.sin(np.deg2rad(20))) / 2
    assert upright.mean() == pytest.approx(0.5 + 0.5 * on_sphere, abs=0.05)
    # A zone of the sphere has the share of its height in the diameter: a quarter lies below -30 degrees.
    assert (elevations < -30).mean() == pytest.approx(0.125, abs=0.04)


def test_equal_ends_fix_the_distance(tmp_path):
    data = contents(build_views(tmp_path / "cans.h5", "can", 1, 2, image_size=16, distance=(4, 4)))
    np.testing.assert_array_equal(data["distances"], 4)


def test_objects_depend_on_the_seed_and_their_own_index_alone(tmp_path):
    few = contents(build_views(tmp_path / "few.h5", "bowl", 1, 2, image_size=24))
    more = contents(build_views(tmp_path / "more.h5", "bowl", 2, 2, image_size=24))
    other = contents(build_views(tmp_path / "other.h5", "bowl", 1, 2, image_size=24, seed=1))
    np.testing.assert_array_equal(few["images"], more["images"][:2])
    assert (few["images"] != other["images"]).any()


def test_a_finished_file_is_reused_and_one_with_other_settings_is_built_anew(tmp_path, caplog):
    path = build_views(tmp_path / "mugs.h5", "mug", 1, 2, image_size=24)
    before = path.stat().st_mtime_ns
    build_views(path, "mug", 1, 2, image_size=24)
    assert path.stat().st_mtime_ns == before
    assert not caplog.records
    build_views(path, "mug", 1, 2, image_size=28)
    assert contents(path)["images"].shape == (2, 28, 28, 4)
    assert "built anew" in caplog.text


def test_an_interrupted_build_goes_on_and_gives_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(view_parts, "SIZE", 1)
    whole = contents(build_views(tmp_path / "whole.h5", "mug", 3, 2, image_size=24))
    drawn = []

    def failing(source, seed, index, held_out):
        drawn.append(index)
        if len(drawn) == 3:
            raise KeyboardInterrupt
        return original(source, seed, index, held_out)

    original = drawn_objects._object
    monkeypatch.setattr(drawn_objects, "_object", failing)
    with pytest.raises(KeyboardInterrupt):
        build_views(tmp_path / "again.h5", "mug", 3, 2, image_size=24)
    assert not (tmp_path / "again.h5").exists()
    resumed = contents(build_views(tmp_path / "again.h5", "mug", 3, 2, image_size=24))
    assert drawn == [0, 1, 2, 2]
    for name, array in whole.items():
        np.testing.assert_array_equal(array, resumed[name])
    assert not list(tmp_path.glob("*.partial"))


def test_several_processes_draw_what_one_draws(tmp_path, monkeypatch):
    here = contents(build_views(tmp_path / "here.h5", "mug", 5, 2, image_size=24))
    monkeypatch.setattr(drawn_objects, "_MANY", 1)
    monkeypatch.setattr(drawn_objects, "cores", lambda: 2)
    elsewhere = contents(build_views(tmp_path / "elsewhere.h5", "mug", 5, 2, image_size=24))
    for name, array in here.items():
        np.testing.assert_array_equal(array, elsewhere[name])


@pytest.mark.parametrize("processes", [1, 2])
def test_a_mesh_that_cannot_be_read_is_named_by_any_process(processes, tmp_path, monkeypatch):
    monkeypatch.setattr(drawn_objects, "_MANY", 1)
    monkeypatch.setattr(drawn_objects, "cores", lambda: processes)
    (tmp_path / "empty.stl").write_text("solid\nendsolid\n")
    with pytest.raises(ValueError, match=r"path must hold triangles, but \S*empty\.stl has none\.$"):
        build_views(tmp_path / "views.h5", find_mesh_files(str(tmp_path / "empty.stl")), 2, 2, image_size=24)
    assert not (tmp_path / "views.h5").exists()


def test_what_a_broken_build_left_is_done_over(tmp_path):
    (tmp_path / "mugs.h5.partial").write_bytes(b"one file, as former versions kept it")
    assert Views(build_views(tmp_path / "mugs.h5", "mug", 1, 2, image_size=24)).num_objects == 1
    folder = tmp_path / "others.h5.partial"
    folder.mkdir()
    (folder / "settings.json").write_text("{}")
    (folder / "000000.npz").write_bytes(b"of other settings")
    assert Views(build_views(tmp_path / "others.h5", "mug", 1, 2, image_size=24)).num_objects == 1


def test_a_damaged_part_is_drawn_again(tmp_path, monkeypatch):
    monkeypatch.setattr(view_parts, "SIZE", 1)
    whole = contents(build_views(tmp_path / "whole.h5", "mug", 2, 2, image_size=24))
    original = ViewParts.write

    def damaging(self, part, drawn):
        original(self, part, drawn)
        if part == 1 and not (tmp_path / "done").exists():
            (tmp_path / "done").touch()
            (self.folder / "000001.npz").write_bytes(b"damaged")

    monkeypatch.setattr(ViewParts, "write", damaging)
    again = contents(build_views(tmp_path / "again.h5", "mug", 2, 2, image_size=24))
    for name, array in whole.items():
        np.testing.assert_array_equal(array, again[name])


def test_mesh_files_are_rendered_too(tmp_path):
    import trimesh

    trimesh.creation.box((1, 1, 1)).export(tmp_path / "box.ply")
    views = Views(build_views(tmp_path / "boxes.h5", [tmp_path / "box.ply"], 2, 2, image_size=24))
    np.testing.assert_allclose(views.extents, np.sqrt(1 / 3), atol=1e-5)
    assert (views.images[0] != views.images[2]).any()


def test_files_of_the_released_code_are_read(tmp_path):
    images = np.full((6, 8, 8, 3), 255, np.uint8)
    images[:, 2:6, 2:6] = 90
    with h5py.File(tmp_path / "released.h5", "w") as file:
        file["images"] = images
        file["poses"] = np.tile([30.0, 40.0], (6, 1))
    views = Views(tmp_path / "released.h5", num_views=3)
    assert (views.num_objects, views.num_views) == (2, 3)
    assert views.depth is None
    assert views.distances is None
    assert views.extents is None
    assert views.masks.sum() == 6 * 16 * 255
    np.testing.assert_allclose(views.elevations, np.pi / 6, rtol=1e-6)
    # As `released_values` has it: the other sense, a quarter-turn away.
    np.testing.assert_allclose(views.azimuths, np.deg2rad(-40 - 90 + 360), rtol=1e-6)
    assert views.azimuths.dtype == np.float32
    with h5py.File(tmp_path / "released.h5", "a") as file:
        file.attrs["num_views"] = 3
    np.testing.assert_allclose(Views(tmp_path / "released.h5").azimuths, np.deg2rad(40), rtol=1e-6)


def test_what_is_transparent_in_a_released_file_is_white(tmp_path):
    images = np.full((2, 4, 4, 4), 7, np.uint8)
    images[:, 1:3, 1:3, 3], images[:, 0, 0, 3] = 255, 0
    with h5py.File(tmp_path / "released.h5", "w") as file:
        file["images"] = images
        file["poses"] = np.zeros((2, 2))
    views = Views(tmp_path / "released.h5", num_views=2)
    assert (views.images[:, 0, 0] == 255).all()
    assert (views.images[:, 1:3, 1:3] == 7).all()


def test_foreign_cut_and_ill_divided_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        Views(tmp_path / "none.h5")
    path = build_views(tmp_path / "mugs.h5", "mug", 1, 2, image_size=24)
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(ValueError, match="cannot be read"):
        Views(cut)
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["pictures"] = np.zeros(3)
    with pytest.raises(ValueError, match="must hold images"):
        Views(tmp_path / "foreign.h5")
    with h5py.File(tmp_path / "odd.h5", "w") as file:
        file["images"] = np.zeros((5, 4, 4, 3), np.uint8)
        file["poses"] = np.zeros((5, 2))
    for num_views in (2, None):
        with pytest.raises(ValueError, match="num_views must divide the 5 rows"):
            Views(tmp_path / "odd.h5", num_views)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_objects": 0}, "num_objects must be at least 1"),
        ({"elevation_deg": (50, 20)}, "elevation_deg must rise within"),
        ({"upright": 1.5}, "upright must lie between 0 and 1"),
        ({"distance": (0.4, 2)}, "distance must rise within 1 to"),
        ({"source": "cup"}, "source must be one of"),
    ],
)
def test_settings_that_make_no_sense_are_refused(tmp_path, change, message):
    settings = {"source": "mug", "num_objects": 1, "num_views": 1, "image_size": 16}
    with pytest.raises(ValueError, match=message):
        build_views(tmp_path / "mugs.h5", **{**settings, **change})

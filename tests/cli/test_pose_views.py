"""`kfit pose a.jpg b.jpg --relative-poses poses.json`: one object in several photos."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage.io import imsave

import kfit
from kfit.cli.main import main
from kfit.cli.pose_views import read_poses, shared_object
from kfit.data import build, pose_view
from kfit.data.rasterizer import standard_intrinsics
from kfit.geometry import rotation_error, rotation_from_angles, to_opencv
from kfit.pose.object_finder import FoundObject
from kfit.segmentation import Segment

SIZE, DISTANCE = 128, 0.6
EYE = np.eye(4).tolist()


def found(*categories: str) -> list[FoundObject]:
    return [FoundObject(name, 0.9, (1, 2, 3, 4), Segment(np.ones((2, 2)))) for name in categories]


def camera_pose(azimuth: float, elevation: float) -> torch.Tensor:
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = to_opencv(rotation_from_angles(*(torch.tensor(a).double() for a in (azimuth, elevation, 0.0))))
    pose[2, 3] = DISTANCE
    return pose


@pytest.fixture
def photos(tmp_path: Path) -> list[str]:
    """Two photos of a mug with their masks, and the cameras' poses to one another."""
    mesh, light = build("mug", 7)
    directions = ((0.6, 0.5), (1.5, 0.4))
    for name, (azimuth, elevation) in zip("ab", directions, strict=True):
        view = pose_view(mesh, elevation, azimuth, light, SIZE)
        for ending, pixels in (("", view.image), ("_mask", view.mask)):
            file = tmp_path / f"{name}{ending}.png"
            imsave(file, (255 * pixels).round().astype(np.uint8), check_contrast=False)
    first, second = (camera_pose(*direction) for direction in directions)
    (tmp_path / "poses.json").write_text(json.dumps([EYE, (second @ torch.linalg.inv(first)).tolist()]))
    return [str(tmp_path / "a.png"), str(tmp_path / "b.png")]


def words(photos: list[str]) -> list[str]:
    focal, _, middle = standard_intrinsics(SIZE)[0].tolist()
    masks = [word for photo in photos for word in ("--mask", photo.replace(".png", "_mask.png"))]
    camera = ["--intrinsics", str(focal), str(focal), str(middle), str(middle)]
    poses = str(Path(photos[0]).with_name("poses.json"))
    return ["pose", *photos, *masks, *camera, "--relative-poses", poses, "--category", "mug"]


@pytest.mark.slow
def test_two_photos_by_known_cameras_have_one_answer(
    photos: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main([*words(photos), "--out", str(tmp_path / "out"), "--report", str(tmp_path / "page.html")])
    printed = capsys.readouterr()
    assert printed.out.startswith("mug ")
    assert len(printed.out.splitlines()) == 1
    answer = json.loads((tmp_path / "out/pose.json").read_text())
    assert answer["size_from"] == "views"
    error = rotation_error(torch.tensor(answer["rotation"]).double(), camera_pose(0.6, 0.5)[:3, :3])
    assert float(torch.rad2deg(error)) < 12
    assert np.linalg.norm(answer["translation"]) == pytest.approx(DISTANCE, rel=0.12)
    assert (tmp_path / "page.html").read_text().count("--mask") == 2


def test_masks_and_boxes_are_given_once_for_each_photo(capsys: pytest.CaptureFixture[str]) -> None:
    box = ["--box", "1", "2", "3", "4"]
    for inputs in (box, ["--mask", "m.png"], [*box, *box, *box]):
        with pytest.raises(SystemExit):
            main(["pose", "a.png", "b.png", *inputs])
        assert f"{inputs[0]} must be given once for each of 2 photos, got" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (["b.png"], "--relative-poses is of several photos of one object, but 1 photo was given"),
        (["--fit", "recipe.yaml"], "--fit and --relative-poses were both given; a recipe fits one photo"),
        (["--depth", "depth.png"], "--depth is of one photo, but 2 were given"),
    ],
)
def test_what_does_not_go_with_several_photos_is_refused(
    change: list[str], message: str, photos: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    inputs = words(photos[:1]) if change == ["b.png"] else [*words(photos), *change]
    with pytest.raises(SystemExit):
        main(inputs)
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no JSON", "holds no JSON list of 4 x 4 matrices"),
        ("[[1, 2], [3]]", "holds no JSON list of 4 x 4 matrices"),
        (json.dumps([EYE]), r"must have shape \(2, 4, 4\)"),
        (json.dumps([EYE, (2 * np.eye(4)).tolist()]), "must be rigid motions"),
        (json.dumps([np.diag([-1.0, -1, 1, 1]).tolist(), EYE]), "must begin with the identity"),
        (json.dumps([EYE, [*EYE[:2], [0, 0, 1, float("nan")], EYE[3]]]), "must be rigid motions"),
    ],
)
def test_files_without_relative_poses_are_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "poses.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"--relative-poses .*{message}"):
        read_poses(str(path), 2)


def test_the_object_that_each_photo_shows_once_is_meant() -> None:
    first, second = found("mug", "can", "can"), found("bottle", "mug")
    assert [one.category for one in shared_object([first, second], ["a", "b"])] == ["mug", "mug"]
    for targets in ([first, found()], [found("mug", "mug"), second], [found("mug", "can"), found("can", "mug")]):
        with pytest.raises(ValueError, match=r"found were .* in a; .* in b; --category NAME, or a --box or --mask"):
            shared_object(targets, ["a", "b"])


def test_the_lens_of_each_photo_must_be_known() -> None:
    photos = [np.random.default_rng(0).random((8, 8, 3)) for _ in range(2)]
    camera = np.array([[10.0, 0, 3.5], [0, 10, 3.5], [0, 0, 1]])
    with pytest.raises(ValueError, match="the lens of photo 1 is unknown: several photos need intrinsics"):
        kfit.load("mug").pose(
            photos, [np.ones((8, 8))] * 2, intrinsics=[None, camera], relative_poses=np.stack([np.eye(4)] * 2)
        )

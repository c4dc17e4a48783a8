import numpy as np
import pytest
import torch

from kfit.geometry import Crop, box_corners, intrinsics_from_fov, project, rotation_from_angles, to_opencv
from kfit.reports.overlay import AXES, BOX, draw_frame, draw_overlay

SIZE = torch.tensor([0.10, 0.07, 0.08])
ROTATION = to_opencv(rotation_from_angles(torch.tensor(0.6), torch.tensor(0.5), torch.tensor(0.1)))
TRANSLATION = torch.tensor([0.02, 0.01, 0.4])


def shown(width: int, height: int, **parts: object) -> np.ndarray:
    image = np.full((height, width, 3), 0.25, np.float32)
    intrinsics = intrinsics_from_fov(width, height)
    return draw_overlay(image, ROTATION, TRANSLATION, SIZE, intrinsics, **parts)  # type: ignore[arg-type]


def is_near(picture: np.ndarray, x: float, y: float, colour: tuple[int, int, int]) -> bool:
    around = picture[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3].astype(int)
    return bool((np.abs(around - np.array(colour)).sum(2) < 60).any())


@pytest.mark.parametrize(("width", "factor"), [(640, 1.0), (3200, 0.4), (100, 4.8)])
def test_the_boxs_corners_are_drawn_where_they_project(width: int, factor: float) -> None:
    height = width * 3 // 4
    picture = shown(width, height)
    assert picture.shape == (round(height * factor), round(width * factor), 3)
    assert picture.dtype == np.uint8
    corners = project(box_corners(ROTATION, TRANSLATION, SIZE), intrinsics_from_fov(width, height))
    places = ((corners + 0.5) * factor - 0.5).tolist()
    # From this side seven corners are seen; the eighth has faint edges only.
    assert sum(is_near(picture, x, y, BOX) for x, y in places) == 7


def test_the_axes_have_their_colours_from_the_centre_outwards() -> None:
    picture = shown(640, 480)
    tips = TRANSLATION + ROTATION.T * 0.2 * SIZE.norm()
    places = project(tips, intrinsics_from_fov(640, 480)).tolist()
    for (x, y), (_, colour) in zip(places, AXES, strict=True):
        assert is_near(picture, x, y, colour)


def test_the_masks_outline_is_drawn_in_white() -> None:
    mask = np.zeros((480, 640), np.float32)
    mask[400:450, 100:200] = 1
    picture = shown(640, 480, mask=mask)
    assert picture[400, 150].min() > 200
    assert picture[425, 150].max() < 100


def test_panels_stand_beside_the_photo_and_the_caption_below() -> None:
    observation, drawing = torch.zeros(3, 64, 64), torch.zeros(3, 64, 64)
    observation[0], drawing[1] = 1, 1
    picture = shown(640, 480, observed=observation, drawing=drawing, caption="mug\n12.5° off")
    assert picture.shape[1] == 640 + 240
    assert picture.shape[0] > 480
    assert picture[120, 760].tolist() == [255, 0, 0]
    assert picture[360, 760].tolist() == [0, 255, 0]
    assert picture[-1, -1].tolist() == [255, 255, 255]
    assert (picture[480:] < 100).any()


def test_a_low_photo_leaves_room_for_panels_that_can_be_read() -> None:
    picture = shown(1000, 100, observed=torch.ones(3, 8, 8), drawing=torch.ones(3, 8, 8))
    assert picture.shape == (320, 1160, 3)


def test_the_arguments_are_left_as_they_were() -> None:
    image = torch.full((60, 80, 3), 0.25)
    mask = torch.ones(60, 80, dtype=torch.bool)
    draw_overlay(image, ROTATION, TRANSLATION, SIZE, intrinsics_from_fov(80, 60), mask=mask)
    assert float(image.min()) == float(image.max()) == 0.25


def test_a_box_that_reaches_behind_the_camera_is_refused() -> None:
    with pytest.raises(ValueError, match="in front of the camera"):
        draw_overlay(torch.ones(60, 80, 3), ROTATION, torch.zeros(3), SIZE, intrinsics_from_fov(80, 60))


@pytest.mark.parametrize(
    ("width", "height", "shown_as"), [(641, 479, (478, 640)), (1920, 1080, (360, 640)), (99, 77, (374, 480))]
)
def test_a_frame_has_even_sides_and_the_box_where_it_projects(width, height, shown_as) -> None:
    image, camera = np.full((height, width, 3), 0.25, np.float32), intrinsics_from_fov(width, height)
    drawn = draw_frame(image, "mug", (ROTATION, TRANSLATION, SIZE, camera))
    assert drawn.shape == (*shown_as, 3)
    factor = np.array(shown_as)[::-1] / (width, height)
    places = (project(box_corners(ROTATION, TRANSLATION, SIZE), camera).numpy() + 0.5) * factor - 0.5
    assert sum(is_near(drawn, x, y, BOX) for x, y in places) == 7


def test_a_frame_shows_the_drawings_outline_where_its_crop_lies() -> None:
    silhouette = np.zeros((64, 64), np.float32)
    silhouette[16:48, 16:48] = 1
    # An eighth of the crop's side is 16 pixels of the photo, twice as many as are shown.
    shown = draw_frame(np.zeros((960, 1280, 3)), "mug", outline=(silhouette, Crop((900.0, 500.0), 128.0)))
    assert shown[250, 450 - 16 - 1 : 450 - 16 + 2].max() > 200
    assert shown[250 - 16 - 1 : 250 - 16 + 2, 450].max() > 200
    assert shown[240:260, 440:460].max() == 0
    assert shown[100:, 480:].max() == 0


def test_a_frame_without_an_answer_has_its_caption_alone() -> None:
    drawn = draw_frame(np.zeros((480, 640, 3)), "not found")
    assert drawn[:20, :60].max() == 255
    assert drawn[60:].max() == 0


@pytest.mark.parametrize("shape", [(240, 320), (320, 180)])
def test_a_long_caption_is_broken_and_stays_within_a_narrow_frame(shape: tuple[int, int]) -> None:
    words = "mug, frame 18, about 64 cm away, unsure, only 50 % likely to be within 20°, found anew"
    short, long = (draw_frame(np.zeros((*shape, 3)), caption) for caption in ("mug", words))
    plates = [int((shown[:, 2] > 200).all(-1).sum()) for shown in (short, long)]
    assert plates[1] > 1.9 * plates[0]
    text = (long[: plates[1]] < 100).all(-1) & (long[: plates[1], :1] > 200).all(-1)
    right = np.flatnonzero((long[: plates[1]] > 200).all(-1).any(0)).max()
    assert text[:, right - 3 : right + 1].sum() == 0  # the last letter ends before the plate does
    assert right < long.shape[1]

"""Makes the pictures of docs/gallery.md and the README's moving one: python docs/drawings/gallery.py [NAME …].

NAME is a category, "moving", "registration", "inversion" or "tracking"; all of them unless named. A category's picture
shows an object that no training saw: the photo, the drawing that explains it, the box, and the fitted mesh from aside.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from app_examples import scene
from PIL import Image
from skimage.io import imread

from kfit.app.examples import EXAMPLES
from kfit.app.views import drawn_in
from kfit.app.watched import Drawn, watched
from kfit.bench.held_out_clip import held_out_clip
from kfit.data import Light, render
from kfit.data.mesh_files import load_mesh
from kfit.data.rasterizer import standard_intrinsics, standard_pose
from kfit.geometry import CATEGORIES
from kfit.models import load
from kfit.pose import PoseResult
from kfit.pose.object_finder import FoundObject, box_of
from kfit.reports import describe, draw_frame
from kfit.reports.fitted_photo import fitted_photo
from kfit.reports.mesh_file import write_mesh
from kfit.reports.overlay import AXES
from kfit.segmentation import Photo, Segment, mask_from_file
from kfit.tracking import track

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs/pictures"
WIDTH, HEIGHT = 320, 240  # of a panel
# Objects that the app's examples lack, as `app_examples.scene` takes them.
RENDERED = {"bowl": (3, 35, 0, "#a7b09a"), "can": (2, 22, 0, "#b9a58c")}
LAMPS = Light(np.full(3, 0.62), np.array([[0.4, 0.75, 0.53]]), np.full((1, 3), 0.5))


def seen(category: str) -> tuple[Photo, np.ndarray]:
    """A picture and the mask of its object."""
    for example in EXAMPLES:
        if example.category == category:
            picture = example.image()
            return Photo(picture.astype(np.float32) / np.float32(255)), mask_from_file(example.mask, picture.shape[:2])
    picture, mask = scene(category, *RENDERED[category])
    return Photo(picture.astype(np.float32) / np.float32(255)), mask.astype(np.float32) / np.float32(255)


@cache
def fitted(category: str) -> tuple[Photo, list[Drawn], PoseResult]:
    """The picture, the drawing after each step, and the answer."""
    photo, mask = seen(category)
    target = FoundObject(category, 1.0, box_of(mask), Segment(mask))
    *steps, result = watched(load(category), photo, target)
    return photo, steps, result


def panel(picture: np.ndarray, center: np.ndarray, side: float) -> np.ndarray:
    """The part of a picture about an object, WIDTH x HEIGHT."""
    scale = HEIGHT / side
    move = np.array([[scale, 0, WIDTH / 2 - scale * center[0]], [0, scale, HEIGHT / 2 - scale * center[1]]])
    return cv2.warpAffine(picture, move, (WIDTH, HEIGHT), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)


def mesh_panel(result: PoseResult) -> np.ndarray:
    """The fitted mesh, seen from 70° beside the photo's camera."""
    with tempfile.TemporaryDirectory() as folder:
        write_mesh(result, Path(folder) / "mesh.ply")
        mesh = load_mesh(Path(folder) / "mesh.ply").normalised()
    azimuth = float(result.fit.values["azimuth"][0]) + np.deg2rad(70)
    camera = standard_intrinsics(HEIGHT, 3.0, 1.0)
    camera[0, 2] += (WIDTH - HEIGHT) / 2
    view = render(mesh, standard_pose(np.deg2rad(22), azimuth, 3.0), camera, (HEIGHT, WIDTH), LAMPS, 3)
    ground = np.array([246, 246, 244])[None, None]
    shown = 255 * (view.image - 1 + view.mask[..., None]) + (1 - view.mask[..., None]) * ground
    return shown.clip(0, 255).round().astype(np.uint8)


def category_picture(category: str) -> None:
    """Photo, drawing in it, box, mesh."""
    photo, steps, result = fitted(category)
    left, top, width, height = result.bbox_xywh
    rows, columns = photo.image.shape[:2]
    side = min(1.5 * max(width, height), rows, columns * HEIGHT / WIDTH)
    half = np.array([side * WIDTH / HEIGHT, side]) / 2
    center = np.clip([left + width / 2, top + height / 2], half, np.array([columns, rows]) - half)
    panels = [(255 * photo.image).round().astype(np.uint8)]
    panels += [drawn_in(photo.image, steps[-1]), fitted_photo(result)]
    shown = []
    for picture in panels:
        scale = picture.shape[1] / photo.image.shape[1]
        shown.append(panel(picture, scale * center, scale * side))
    save(np.concatenate([*shown, mesh_panel(result)], 1), f"gallery_{category}")
    print(describe(result))


def moving() -> None:
    """The cup's drawing on its way, then the answer, as a GIF."""
    photo, steps, result = fitted("mug")
    size = (450, 300)
    frames = [cv2.resize(drawn_in(photo.image, step), size, interpolation=cv2.INTER_AREA) for step in steps]
    frames.append(cv2.resize(fitted_photo(result), size, interpolation=cv2.INTER_AREA))
    # One palette for all frames, so that what does not move costs nothing; it has the colours of the axes.
    axes = np.repeat(np.uint8([[color] for _, color in AXES]), 20, 0).repeat(size[0], 1)
    palette = Image.fromarray(np.concatenate([frames[0], frames[len(frames) // 2], frames[-1], axes])).quantize(192)
    shown = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    lasts = [700, *[130] * (len(frames) - 2), 3200]
    shown[0].save(PICTURES / "fit.gif", save_all=True, append_images=shown[1:], duration=lasts, loop=0, optimize=True)
    save(cv2.resize(fitted_photo(result), (900, 600), interpolation=cv2.INTER_AREA), "answer")


def tracking() -> None:
    """Four frames of a clip, tracked with its masks."""
    model = load("mug")
    clip = held_out_clip(model, 7, 36)
    picked = []
    for number, answer in enumerate(track(model, clip.frames, masks=clip.masks, intrinsics=clip.intrinsics)):
        pose = (answer.rotation, answer.translation, answer.size, answer.intrinsics)
        shown = draw_frame(
            clip.frames[number], f"frame {number}", pose, (answer.silhouette, answer.crop), answer.confidence
        )
        picked += [cv2.resize(shown, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)] if number % 9 == 0 else []
    save(np.concatenate(picked, 1), "gallery_tracking")


def from_example(script: str, name: str) -> None:
    """The picture that an example writes."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, ROOT / "examples" / f"{script}.py", folder], check=True)
        picture = imread(Path(folder) / f"{script}.png")[..., :3]
    size = (4 * WIDTH, round(picture.shape[0] * 4 * WIDTH / picture.shape[1]))
    save(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), name)


def save(picture: np.ndarray, name: str) -> None:
    """Write a JPEG file."""
    Image.fromarray(picture).save(PICTURES / f"{name}.jpg", quality=84, optimize=True)


if __name__ == "__main__":
    made = {
        "moving": moving,
        **{category: (lambda category=category: category_picture(category)) for category in CATEGORIES},
        "registration": lambda: from_example("register_photos", "gallery_registration"),
        "inversion": lambda: from_example("invert_a_generator", "gallery_inversion"),
        "tracking": tracking,
    }
    for name in sys.argv[1:] or made:
        made[name]()

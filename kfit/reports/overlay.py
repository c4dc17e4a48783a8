"""A fit drawn on its photo: box, axes and outline, with the observation and the drawing at its side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.geometry import EDGES, Crop, box_corners, project
from kfit.reports.lettering import INK, Colour, Picture, caption_strip, draw_label, draw_tag
from kfit.reports.words import Level, confidence_level

# Of the photo's longer side as shown: larger photos shrink, smaller ones grow until a label can be read.
LARGEST, SMALLEST = 1280, 480
BOX, OUTLINE = (255, 176, 0), (255, 255, 255)
LEVELS: dict[Level, Colour] = {"high": (95, 220, 120), "medium": (255, 192, 105), "low": (255, 110, 100)}
AXES = (("x", (230, 40, 40)), ("y", (30, 170, 60)), ("z", (40, 90, 240)))
# Of a video's frame: encoding 640 pixels takes about as long as following.
LARGEST_FRAME = 640
# OpenCV draws with a precision of 1/16 pixel by its argument `shift`.
BITS = 4


def draw_overlay(
    image: Any,
    rotation: Any,
    translation: Any,
    size: Any,
    intrinsics: Any,
    observed: Tensor | None = None,
    drawing: Tensor | None = None,
    mask: Any = None,
    caption: str | None = None,
) -> Picture:
    """Draw a pose on its photo.

    The object's box is orange, its hidden edges thin and faint; its axes start at the centre, x red, y green, z blue.
    The photo is shown at most 1280 pixels long.

    Args:
        image: (H, W, 3) array or tensor, RGB in [0, 1].
        rotation: (3, 3) array, tensor or nested lists, as the next three: object to camera, OpenCV axes.
        translation: (3,) in metres.
        size: (3,) extents of the object in metres.
        intrinsics: (3, 3) of the photo.
        observed: (3, S, S), the observed crop, for a panel at the side of the photo.
        drawing: (3, S, S), the generator's picture, for another.
        mask: (H, W) array or tensor, whose outline is drawn in white.
        caption: line or lines for the strip below.

    Returns:
        (height, width, 3) RGB bytes.

    Raises:
        ValueError: if the box reaches behind the camera.
    """
    photo, move, thick = _photo_to_draw_on(image)
    if mask is not None:
        _draw_outline(photo, np.asarray(torch.as_tensor(mask).cpu(), np.float32), thick)
    rotation, translation, size, camera = (
        torch.as_tensor(value).detach().cpu().double() for value in (rotation, translation, size, intrinsics)
    )
    _draw_pose(photo, rotation, translation, size, move @ camera, thick)
    if observed is not None or drawing is not None:
        draw_label(photo, "photo", thick)
    side = max(160, photo.shape[0] // 2)
    panels = []
    for label, picture in (("seen", observed), ("fitted", drawing)):
        if picture is not None:
            panels.append(_resized(_bytes(picture.movedim(0, -1)), side, side))
            draw_label(panels[-1], label, thick)
    shown = _with_panels(photo, panels)
    return shown if caption is None else np.concatenate((shown, caption_strip(caption, shown.shape[1], thick)))


def draw_objects(image: Any, poses: Sequence[Mapping[str, Any]], caption: str | None = None) -> Picture:
    """Draw the poses of several objects on their photo, numbered from 1.

    Args:
        image: (H, W, 3) array or tensor, RGB in [0, 1].
        poses: for each object its rotation, translation, size, intrinsics and mask, as `draw_overlay` takes them.
        caption: line or lines for the strip below.

    Returns:
        (height, width, 3) RGB bytes.
    """
    photo, move, thick = _photo_to_draw_on(image)
    for pose in poses:
        _draw_outline(photo, np.asarray(torch.as_tensor(pose["mask"]).cpu(), np.float32), thick)
    for number, pose in enumerate(poses, 1):
        rotation, translation, size, camera = (
            torch.as_tensor(pose[name]).double() for name in ("rotation", "translation", "size", "intrinsics")
        )
        _draw_pose(photo, rotation, translation, size, move @ camera, thick)
        rows, columns = (np.flatnonzero((np.asarray(pose["mask"]) > 0.5).any(axis)) for axis in (1, 0))
        corner = move[:2, :2] @ torch.tensor([columns[0], rows[0]], dtype=torch.float64)
        draw_tag(photo, str(number), corner, INK, 1.5 * thick)
    return photo if caption is None else np.concatenate((photo, caption_strip(caption, photo.shape[1], thick)))


def draw_frame(
    image: Any,
    caption: str,
    pose: tuple[Any, Any, Any, Any] | None = None,
    outline: tuple[NDArray[np.float32], Crop] | None = None,
    confidence: float | None = None,
) -> Picture:
    """Draw a pose on its frame of a video.

    The frame is shown 480 to 640 pixels long, with sides of even numbers, as videos need them. A bar along its lower
    edge shows the confidence; bar and outline are green where it is high, amber, and red where it is low.

    Args:
        image: (H, W, 3) array or tensor, RGB in [0, 1].
        caption: a few words for the upper left corner.
        pose: rotation, translation, size and intrinsics, arrays or tensors as `draw_overlay` takes them.
        outline: silhouette (S, S) of the drawing, above 1/2 on the object, in the pixels of the crop.
        confidence: confidence of the pose, in [0, 1].

    Returns:
        (height, width, 3) RGB bytes.
    """
    frame = _bytes(torch.as_tensor(image))
    height, width = frame.shape[:2]
    factor = min(max(SMALLEST, height, width), LARGEST_FRAME) / max(height, width)
    shown = _resized(frame, 2 * max(1, round(factor * width / 2)), 2 * max(1, round(factor * height / 2)))
    across, down, thick = shown.shape[1] / width, shown.shape[0] / height, max(1.0, max(shown.shape[:2]) / 400)
    move = torch.tensor([[across, 0, across / 2 - 0.5], [0, down, down / 2 - 0.5], [0, 0, 1]], dtype=torch.float64)
    if outline is not None:
        silhouette, crop = outline
        to_shown = (move @ crop.crop_to_image).numpy()[:2]
        color = OUTLINE if confidence is None else LEVELS[confidence_level(confidence)]
        _draw_outline(shown, cv2.warpAffine(silhouette, to_shown, (shown.shape[1], shown.shape[0])), thick, color)
    if pose is not None:
        rotation, translation, size, intrinsics = (torch.as_tensor(part).double() for part in pose)
        _draw_pose(shown, rotation, translation, size, move @ intrinsics, thick)
    draw_label(shown, caption, thick)
    if confidence is not None:
        high, wide = round(5 * thick), round(confidence * shown.shape[1])
        shown[-high:] = INK
        shown[-high:, :wide] = LEVELS[confidence_level(confidence)]
    return shown


def _photo_to_draw_on(image: Any) -> tuple[Picture, Tensor, float]:
    """Return the photo at display size, the map (3, 3) of its pixels to the display's, and the width of lines."""
    photo = _bytes(torch.as_tensor(image))
    factor = min(max(SMALLEST, max(photo.shape[:2])), LARGEST) / max(photo.shape[:2])
    photo = _resized(photo, round(photo.shape[1] * factor), round(photo.shape[0] * factor))
    # Pixel centres are at integers, so it is the picture's corner at −1/2 that stays where it is.
    move = torch.tensor([[factor, 0, factor / 2 - 0.5], [0, factor, factor / 2 - 0.5], [0, 0, 1]], dtype=torch.float64)
    return photo, move, max(1.0, max(photo.shape[:2]) / 400)


def _draw_pose(
    photo: Picture, rotation: Tensor, translation: Tensor, size: Tensor, intrinsics: Tensor, thick: float
) -> None:
    corners = project(box_corners(rotation, translation, size), intrinsics)
    # A face is seen if its outward normal points against the ray to its middle: facing[axis, side].
    out = torch.stack((-rotation.T, rotation.T), 1)
    middles = translation + out * size[:, None, None] / 2
    facing = (out * middles).sum(-1) < 0
    edges: dict[bool, list[tuple[Tensor, Tensor]]] = {True: [], False: []}
    for i, j in EDGES:
        faces = [facing[k, i >> k & 1] for k in range(3) if not (i ^ j) >> k & 1]
        edges[any(faces)].append((corners[i], corners[j]))
    dimmed = photo.copy()
    for start, end in edges[False]:
        _line(dimmed, start, end, BOX, thick / 2)
    cv2.addWeighted(dimmed, 0.5, photo, 0.5, 0, dst=photo)
    for start, end in edges[True]:
        _line(photo, start, end, BOX, thick)
    tips = translation + rotation.T * 0.35 * size.norm()
    ends = project(torch.cat((translation[None], tips)), intrinsics)
    # The axis that points away most is drawn first, so that nearer ones cover it.
    for k in tips[:, 2].argsort(descending=True).tolist():
        name, colour = AXES[k]
        _line(photo, ends[0], ends[k + 1], colour, 1.5 * thick)
        draw_tag(photo, name, ends[k + 1], colour, thick)


def _draw_outline(photo: Picture, mask: NDArray[np.float32], thick: float, color: Colour = OUTLINE) -> None:
    large = cv2.resize(mask, (photo.shape[1], photo.shape[0]), interpolation=cv2.INTER_LINEAR)
    outlines, _ = cv2.findContours((large > 0.5).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    rim, line = photo.copy(), max(1, round(thick))
    cv2.polylines(rim, outlines, True, INK, line + 2, cv2.LINE_AA)  # or it is lost on a white object
    cv2.addWeighted(rim, 0.6, photo, 0.4, 0, dst=photo)
    cv2.polylines(photo, outlines, True, color, line, cv2.LINE_AA)


def _line(picture: Picture, start: Tensor, end: Tensor, colour: Colour, thick: float) -> None:
    # Far outside the picture a sixteenth of a pixel would not fit into OpenCV's integers.
    a, b = (tuple((p.clamp(-1e6, 1e6) * 2**BITS).round().int().tolist()) for p in (start, end))
    cv2.line(picture, a, b, colour, max(1, round(thick)), cv2.LINE_AA, BITS)


def _with_panels(photo: Picture, panels: list[Picture]) -> Picture:
    if not panels:
        return photo
    height = max(photo.shape[0], sum(p.shape[0] for p in panels))
    shown = np.full((height, photo.shape[1] + panels[0].shape[1], 3), 255, np.uint8)
    shown[: photo.shape[0], : photo.shape[1]] = photo
    for k, panel in enumerate(panels):
        top = k * panel.shape[0]
        shown[top : top + panel.shape[0], photo.shape[1] :] = panel
    return shown


def _resized(picture: Picture, width: int, height: int) -> Picture:
    way = cv2.INTER_AREA if width < picture.shape[1] else cv2.INTER_CUBIC
    return np.ascontiguousarray(cv2.resize(picture, (max(1, width), max(1, height)), interpolation=way))


def _bytes(picture: Tensor) -> Picture:
    array: Picture = (picture.detach().cpu().float().clamp(0, 1) * 255).round().byte().numpy()
    return np.ascontiguousarray(array)

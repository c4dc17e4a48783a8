"""Objectron's annotations of a video: boxes in the world and the camera of each frame (Ahmadyan et al. 2021)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from kfit.core.arguments import check_arguments
from kfit.data.annotated_frame import WORDS, AnnotatedFrame, AnnotatedObject
from kfit.data.annotated_frames import AnnotatedFrames

_LARGEST = 200_000_000
# From ARKit's camera of the landscape sensor (x right, y up, z backwards) to OpenCV's of the upright picture.
_UPRIGHT = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
_PICTURES = (".jpg", ".jpeg", ".png")


class ObjectronFrames(AnnotatedFrames):
    """Frames of one video by its ``annotation.pbdata``, with pictures extracted from it.

    Pictures are named by the frame's number (``0.jpg`` or ``000000.png``, from 0 on, as
    ``ffmpeg -i video.MOV -start_number 0 images/%d.jpg`` writes them). A cup is called a mug; boxes have y up, and
    their fronts follow Objectron's convention. There are neither masks nor depth.

    Args:
        annotation: path of the file.
        images: folder of the pictures.
    """

    def __init__(self, annotation: str, images: str) -> None:
        check_arguments(ObjectronFrames, locals())
        self.file = Path(annotation)
        if not self.file.is_file():
            raise FileNotFoundError(f"there is no annotation {annotation}")
        if self.file.stat().st_size > _LARGEST:
            raise ValueError(f"{annotation} has {self.file.stat().st_size:,} bytes, more than {_LARGEST:,}")
        pictures = {
            int(path.stem): path
            for path in sorted(Path(images).glob("*"))
            if path.suffix.lower() in _PICTURES and path.stem.isdecimal()
        }
        if not pictures:
            raise FileNotFoundError(f"{images} holds no pictures that are named by numbers")
        try:
            sequence = _message(self.file.read_bytes())
            self.objects = [_message(one) for one in sequence.get(1, [])]
            frames = [_message(one) for one in sequence.get(2, [])]
            self.frames = [(_number(frame), _message(frame[3][0])) for frame in frames if 3 in frame]
        except (ValueError, IndexError, struct.error, TypeError) as error:
            raise ValueError(f"{annotation} is no annotation of Objectron: {error}") from None
        self.shown = [(pictures[number], camera) for number, camera in self.frames if number in pictures]
        if not self.shown:
            raise ValueError(f"no frame of {annotation} has its picture in {images}")

    def __len__(self) -> int:
        return len(self.shown)

    def result_name(self, index: int) -> str:
        return f"results_{self.file.parent.name}_{self.shown[index][0].stem}.pkl"

    def __getitem__(self, index: int) -> AnnotatedFrame:
        picture, camera = self.shown[index]
        view = _floats(camera, 9, 16, self.file).reshape(4, 4)
        sensor = _floats(camera, 7, 9, self.file).reshape(3, 3)
        width, height = (int(camera.get(field, [default])[0]) for field, default in ((5, 1920), (6, 1440)))
        _check_size(picture, (height, width))
        # The sensor's rows are the upright picture's columns, from right to left.
        intrinsics = np.array(
            [[sensor[1, 1], 0, height - 1 - sensor[1, 2]], [0, sensor[0, 0], sensor[0, 2]], [0, 0, 1]]
        )
        things = tuple(self._object(thing, view, intrinsics) for thing in self.objects)
        where = Path(self.file.parent.parent.name, self.file.parent.name, picture.stem)
        return AnnotatedFrame(where, picture, intrinsics, things)

    def _object(
        self, thing: dict[int, list[Any]], view: NDArray[np.float64], intrinsics: NDArray[np.float64]
    ) -> AnnotatedObject:
        rotation = _floats(thing, 4, 9, self.file).reshape(3, 3)
        translation, size = (_floats(thing, field, 3, self.file) for field in (5, 6))
        name = bytes(thing.get(2, [b""])[0]).decode("utf-8", "replace")
        turn = _UPRIGHT @ view[:3, :3]
        placed = turn @ translation + _UPRIGHT @ view[:3, 3]
        return AnnotatedObject.of(_number(thing), WORDS.get(name, name), turn @ rotation, placed, size, intrinsics)


def _check_size(picture: Path, upright: tuple[int, int]) -> None:
    """Refuse a picture of another width and height than the camera's, whose intrinsics would be wrong."""
    try:
        with Image.open(picture) as opened:
            size = opened.size
    except (OSError, Image.DecompressionBombError) as error:
        raise ValueError(f"{picture} is no picture: {error}") from None
    if size != upright:
        raise ValueError(
            f"{picture} has {size[0]} x {size[1]} pixels, but the annotated camera {upright[0]} x {upright[1]}; "
            "extract upright frames at full size"
        )


def _number(message: dict[int, list[Any]]) -> int:
    """Return the field's integer; files omit 0."""
    return int(message.get(1, [0])[0])


def _floats(message: dict[int, list[Any]], field: int, count: int, file: Path) -> NDArray[np.float64]:
    """Return a field of ``count`` single-precision numbers, packed or repeated."""
    content = b"".join(bytes(part) for part in message.get(field, []))
    if len(content) != 4 * count:
        raise ValueError(f"{file}: field {field} must hold {count} numbers, got {len(content)} bytes")
    return np.frombuffer(content, "<f4").astype(np.float64)


def _message(content: bytes) -> dict[int, list[Any]]:
    """Parse a Protocol Buffers message into its fields by number: integers, and bytes for all other kinds.

    Raises:
        ValueError: If it is truncated or not such a message.
    """
    fields: dict[int, list[Any]] = {}
    for field, value in _fields(memoryview(content)):
        fields.setdefault(field, []).append(value)
    return fields


def _fields(content: memoryview) -> Iterator[tuple[int, Any]]:
    place = 0
    while place < len(content):
        key, place = _varint(content, place)
        kind = key & 7
        if kind == 0:
            value, place = _varint(content, place)
            yield key >> 3, value
            continue
        if kind == 2:
            length, place = _varint(content, place)
        elif kind in (1, 5):
            length = 8 if kind == 1 else 4
        else:
            raise ValueError(f"a field of kind {kind}")
        if place + length > len(content):
            raise ValueError("it is cut short")
        yield key >> 3, bytes(content[place : place + length])
        place += length


def _varint(content: memoryview, place: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(content):
            raise ValueError("it is cut short")
        byte = content[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if not byte & 0x80:
            return value, place
    raise ValueError("a number of more than ten bytes")

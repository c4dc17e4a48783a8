"""Frame sizes from a clip's packets: OpenCV scales frames of another size to the first one's."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import cv2
from PIL import Image

Size = tuple[int, int]


def size_change(path: Path) -> tuple[int, Size, Size] | None:
    """Find the first packet whose frame is not as large as the first one's.

    Motion JPEG, VP8 and VP9 have the size in their packets, which are read without decoding; clips of other codecs
    are not checked.

    Args:
        path: path of a clip that OpenCV reads.

    Returns:
        its number from 0, its width and height, and those of the first; None where all are alike.
    """
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    codec = (int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF).to_bytes(4, "little")
    size_of, first, number = CODECS.get(codec), None, 0
    while size_of is not None:
        read, packet = capture.read()
        if not read:
            break
        size = size_of(packet.tobytes())
        first = first or size
        if size is not None and size != first and first is not None:
            return number, size, first
        number += 1
    return None


def _jpeg(packet: bytes) -> Size | None:
    try:
        with Image.open(BytesIO(packet), formats=["JPEG"]) as picture:
            return picture.size
    except OSError:
        return None


def _vp8(packet: bytes) -> Size | None:
    """RFC 6386, section 9.1: a key frame's start code is followed by 14 bits each of width and height."""
    if len(packet) < 10 or packet[0] & 1 or packet[3:6] != b"\x9d\x01\x2a":
        return None
    return int.from_bytes(packet[6:8], "little") & 0x3FFF, int.from_bytes(packet[8:10], "little") & 0x3FFF


def _vp9(packet: bytes) -> Size | None:
    """VP9 bitstream specification, section 6.2: sizes of key frames of profiles 0 and 2."""
    head = packet[:12]
    bits = "".join(f"{byte:08b}" for byte in head)
    if len(head) < 12 or bits[:2] != "10" or bits[2] == "1" or bits[4:6] != "00" or head[1:4] != b"\x49\x83\x42":
        return None
    at = 32 + (bits[3] == "1")  # profile 2 has a bit depth
    if bits[at : at + 3] == "111":  # RGB, which these profiles do not have
        return None
    at += 4
    return int(bits[at : at + 16], 2) + 1, int(bits[at + 16 : at + 32], 2) + 1


CODECS: dict[bytes, Callable[[bytes], Size | None]] = {b"MJPG": _jpeg, b"VP80": _vp8, b"VP90": _vp9}

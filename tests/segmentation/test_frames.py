"""Frames read from clips and folders."""

import os
import resource
import struct

import cv2
import numpy as np
import pytest
from skimage.io import imsave

from kfit.segmentation import Frames, pictures
from kfit.segmentation.packet_sizes import CODECS

SHADES = (40, 80, 120, 160, 200)


def clip(path):
    """A video whose left half is ever lighter."""
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, (48, 32))
    for shade in SHADES:
        picture = np.zeros((32, 48, 3), np.uint8)
        picture[:, :24] = shade
        video.write(picture)
    video.release()
    return path


def test_a_clip_gives_its_frames_with_their_times(tmp_path):
    frames = Frames.of(clip(tmp_path / "clip.mp4"))
    assert (frames.count, frames.rate) == (5, 25)
    observed = list(frames)
    assert [frame.time for frame in observed] == pytest.approx([0, 0.04, 0.08, 0.12, 0.16])
    assert [frame.photo.image.shape for frame in observed] == [(32, 48, 3)] * 5
    assert [255 * frame.photo.image[16, 8].mean() for frame in observed] == pytest.approx(SHADES, abs=4)
    assert frames.note == ""


def test_colours_are_red_green_blue(tmp_path):
    video = cv2.VideoWriter(str(tmp_path / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25, (48, 32))
    video.write(np.full((32, 48, 3), (0, 0, 255), np.uint8))  # OpenCV's red
    video.release()
    (frame,) = Frames.of(tmp_path / "clip.mp4")
    assert frame.photo.image[16, 24] == pytest.approx([1, 0, 0], abs=0.05)


def test_a_phones_clip_is_turned_upright(tmp_path):
    path = clip(tmp_path / "clip.mp4")
    data = bytearray(path.read_bytes())
    matrix = data.index(b"tkhd") + 44  # of version 0: rows (a, b, u), (c, d, v), (x, y, w)
    rotated = [0, 1 << 16, 0, -(1 << 16), 0, 0, 32 << 16, 0, 1 << 30]  # by 90°, clockwise
    data[matrix : matrix + 36] = b"".join(number.to_bytes(4, "big", signed=True) for number in rotated)
    path.write_bytes(data)
    image = next(iter(Frames.of(path))).photo.image
    assert image.shape == (48, 32, 3)
    assert image[:20].mean() > image[28:].mean() + 0.1  # what was left is above


def test_frames_are_read_as_they_are_asked_for(tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    imsave(folder / "1.png", np.full((8, 8, 3), 9, np.uint8), check_contrast=False)
    (folder / "2.png").write_text("no picture")
    frames = iter(Frames.of(folder))
    assert next(frames).photo.image.shape == (8, 8, 3)
    with pytest.raises(ValueError, match=r"2\.png is not an image"):
        next(frames)


def test_pictures_are_sorted_by_their_numbers(tmp_path):
    names = ["f2.png", "f10.PNG", "f1.jpg", "f010b.png", ".hidden.png", "notes.txt"]
    for name in names:
        (tmp_path / name).touch()
    assert [path.name for path in pictures(tmp_path)] == ["f1.jpg", "f2.png", "f10.PNG", "f010b.png"]


def test_a_clip_that_was_cut_short_says_so_after_its_last_frame(tmp_path):
    path = tmp_path / "clip.webm"
    noise = np.random.default_rng(0).integers(0, 255, (20, 64, 64, 3), np.uint8)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"VP80"), 25, (64, 64))
    for picture in noise:
        video.write(picture)
    video.release()
    os.truncate(path, path.stat().st_size // 2)
    frames = Frames.of(path)
    number = len(list(frames))
    assert 0 < number < 18
    assert f"cut short: {number} of the 20 frames" in frames.note


def test_what_cannot_be_read_gets_one_sentence(tmp_path):
    cut = clip(tmp_path / "cut.mp4")
    os.truncate(cut, cut.stat().st_size // 2)
    (tmp_path / "empty").mkdir()
    (tmp_path / "no.mp4").write_text("no clip")
    for name, sentence in {
        "none.mp4": "there is no clip or folder",
        "no.mp4": "is not a clip that can be read",
        "cut.mp4": "is not a clip that can be read, is damaged",
        "empty": "holds no pictures",
    }.items():
        with pytest.raises((ValueError, FileNotFoundError), match=sentence):
            Frames.of(tmp_path / name)
    imsave(tmp_path / "one.png", np.zeros((8, 8, 3), np.uint8), check_contrast=False)
    with pytest.raises(ValueError, match="is one picture"):
        Frames.of(tmp_path / "one.png")


def test_a_clip_of_huge_frames_is_refused_before_one_is_decoded(tmp_path):
    size = struct.pack("<HH", 16000, 16000)
    path = tmp_path / "huge.gif"
    path.write_bytes(b"GIF89a" + size + b"\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0" + size + b"\0\2\2D\1\0;")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match=r"huge\.gif has frames of 16000 x 16000 pixels, more than 65 megapixels"):
        Frames.of(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kilobytes


def test_a_clip_whose_frames_change_size_is_refused(tmp_path):
    path = tmp_path / "changing.mjpeg"
    frames = [np.zeros((48, 64, 3), np.uint8)] * 3 + [np.zeros((80, 96, 3), np.uint8)]
    path.write_bytes(b"".join(cv2.imencode(".jpg", frame)[1].tobytes() for frame in frames))
    with pytest.raises(ValueError, match=r"frame 3 of .*changing\.mjpeg has 96 x 80 pixels, the first 64 x 48"):
        Frames.of(path)
    path.write_bytes(b"".join(cv2.imencode(".jpg", frame)[1].tobytes() for frame in frames[:3]))
    assert len(list(Frames.of(path))) == 3


@pytest.mark.parametrize(
    ("codec", "packet"),
    [
        (b"VP80", "b003009d012a600050000047"),
        (b"VP90", "824983420005f004f6003824"),
    ],
)
def test_the_size_of_a_frame_is_read_off_its_packet(codec, packet):
    # the first 12 bytes of what FFmpeg wrote of frames of 96 x 80
    assert CODECS[codec](bytes.fromhex(packet)) == (96, 80)
    assert CODECS[codec](b"\xff" * 12) is None


def test_a_frame_of_another_size_is_named(tmp_path):
    for name, side in {"1.png": 8, "2.png": 9}.items():
        imsave(tmp_path / name, np.zeros((8, side, 3), np.uint8), check_contrast=False)
    with pytest.raises(ValueError, match=r"2\.png has 9 x 8 pixels, the first 8 x 8"):
        list(Frames.of(tmp_path))

"""Videos written for browsers."""

import cv2
import numpy as np
import pytest

from kfit.reports import VideoFile


def test_pictures_come_back_from_the_file_in_their_colours_and_order(tmp_path, capfd):
    colours = [(200, 30, 30), (30, 200, 30), (30, 30, 200)]
    with VideoFile(tmp_path / "video.webm", 12.5) as video:
        for colour in colours:
            video.write(np.full((48, 64, 3), colour, np.uint8))
    assert capfd.readouterr().err == ""
    assert (tmp_path / "video.webm").read_bytes()[:4] == b"\x1a\x45\xdf\xa3"  # of Matroska and WebM
    read = cv2.VideoCapture(str(tmp_path / "video.webm"))
    assert read.get(cv2.CAP_PROP_FPS) == 12.5
    assert int(read.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little") == b"VP80"
    for colour in colours:
        there, picture = read.read()
        assert there
        assert picture[24, 32, ::-1] == pytest.approx(colour, abs=12)
    assert not read.read()[0]


def test_a_place_that_cannot_be_written_to_is_reported(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no/video\.webm"), VideoFile(tmp_path / "no/video.webm", 25) as v:
        v.write(np.zeros((48, 64, 3), np.uint8))


def test_another_ending_is_refused_in_one_sentence() -> None:
    with pytest.raises(ValueError, match=r"path must end in \.webm or \.mp4, got 'clip\.avi'"):
        VideoFile("clip.avi", 25)

"""What a visitor hands in is kept apart and deleted."""

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import kfit
from kfit.app import session, sessions
from kfit.app.downloads import FILES, snippet_of
from kfit.app.examples import EXAMPLES
from kfit.app.session import Session
from kfit.app.sessions import Sessions
from kfit.app.watched import Drawn
from kfit.pose import PoseResult
from kfit.pose.object_finder import FoundObject
from kfit.segmentation import ObjectMask, Photo, Segment


@pytest.fixture
def visit(tmp_path):
    (tmp_path / "own").mkdir()
    return Session(tmp_path / "own")


def test_a_photo_is_read_and_its_file_deleted(visit, upload, drawn_mug):
    path = upload(drawn_mug[..., :3])
    visit.take(path)
    assert visit.photo.image.shape == (128, 128, 3)
    assert not path.exists()


def test_what_is_found_in_a_photo_can_be_chosen(visit, upload, drawn_mug, monkeypatch):
    masks = [np.eye(128, dtype=np.float32), np.ones((128, 128), np.float32)]
    targets = [FoundObject(name, 0.9, (1, 2, 3, 4), Segment(mask)) for name, mask in zip("ab", masks, strict=True)]
    monkeypatch.setattr(session, "find_targets", lambda photo: targets)
    visit.take(upload(drawn_mug[..., :3]))
    assert visit.found() == ["a (90 %)", "b (90 %)"]
    assert visit.mask is masks[0]
    visit.choose(1)
    assert visit.mask is masks[1]
    assert visit.command("b") == "kfit pose mug.png"
    assert visit.command("mug") == "kfit pose mug.png --category mug --box 1 2 3 4"
    visit.take(upload(drawn_mug))
    assert visit.found() == []


def test_a_file_that_is_refused_is_deleted_too_and_what_was_there_stays(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug))
    before = visit.photo
    path = upload(drawn_mug, "other.png")
    path.write_bytes(b"nothing")
    with pytest.raises(ValueError, match="no JPEG, PNG, WebP, AVIF or HEIC"):
        visit.take(path)
    assert not path.exists()
    assert visit.photo is before


def test_an_alpha_channel_does_without_a_box(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug))
    assert np.array_equal(visit.mask, drawn_mug[..., 3].astype(np.float32) / np.float32(255))
    assert visit.command(visit.target.category) == "kfit pose mug.png"
    assert visit.command("bowl") == "kfit pose mug.png --category bowl"


def test_a_box_is_cut_as_the_command_line_does(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug[..., :3], "my mug.png"))
    rows, columns = (np.flatnonzero((drawn_mug[..., 3] > 0).any(axis)) for axis in (1, 0))
    box = (columns[0], rows[0], columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0])
    visit.draw(tuple((number + 0.3) / 128 for number in box))
    assert np.array_equal(visit.mask, ObjectMask()(visit.photo.image, "mug", tuple(map(float, box))).mask)
    assert visit.command("mug") == "kfit pose 'my mug.png' --category mug --box " + " ".join(map(str, box))


def test_a_box_in_which_nothing_is_leaves_no_mask(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug))
    with pytest.raises(ValueError, match="leaves less than 4 pixels"):
        visit.draw((0.1, 0.1, 0.01, 0.01))
    assert visit.mask is None
    with pytest.raises(ValueError, match=r"^Draw a box around the object first"):
        visit.fit("mug")


def test_an_uploaded_mask_does_without_a_box(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug[..., :3]))
    path = upload(drawn_mug[..., 3], "mask.png")
    visit.take_mask(path)
    assert np.array_equal(visit.mask > 0, drawn_mug[..., 3] > 127)
    assert not path.exists()
    assert visit.command("mug") == "kfit pose mug.png --category mug --mask mask.png"
    with pytest.raises(ValueError, match=r"^mask small.png has 9 x 9 pixels, the photo 128 x 128$"):
        visit.take_mask(upload(drawn_mug[:9, :9, 3], "small.png"))
    assert visit.mask.any()


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_an_example_has_a_mask_of_its_size_and_a_category(visit, example):
    visit.take_example(example)
    assert visit.mask.shape == visit.photo.image.shape[:2]
    assert 0.02 < visit.mask.mean() < 0.5
    assert visit.category == example.category
    assert visit.command("mug") == f"kfit pose {example.name}.png --category mug --mask mask.png"


def test_the_cups_mask_is_that_of_the_examples_folder():
    examples = Path(kfit.__file__).parents[1] / "examples"
    assert EXAMPLES[0].mask.read_bytes() == (examples / "coffee_mask.png").read_bytes()


def test_a_brush_adds_to_a_mask_and_takes_from_it(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug))
    before = visit.mask.copy()
    visit.paint([(0.05, 0.05), (0.05, 0.5)], keep=True)
    assert visit.mask[10, 6] == 1
    assert visit.mask.sum() > (before > 0.5).sum()
    visit.paint([(0.05, 0.05), (0.05, 0.5)], keep=False)
    assert visit.mask[10, 6] == 0
    assert visit.command("mug") == "kfit pose mug.png --category mug --mask mask.png"
    visit.paint([(0.05, 0.05)], keep=True)  # a click
    assert visit.mask[6, 6] == 1
    everywhere = [(x, y) for y in np.linspace(0, 1, 60) for x in (0, 1)]
    with pytest.raises(ValueError, match=r"^Nothing would be left"):
        visit.paint(everywhere, keep=False)
    assert visit.mask.any()


def test_a_brush_needs_a_mask(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug[..., :3]))
    visit.target = None
    with pytest.raises(ValueError, match=r"^Draw a box around the object first"):
        visit.paint([(0.5, 0.5)], keep=True)


def test_camera_and_depth_are_part_of_the_command_and_of_the_program(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug))
    visit.take_depth(upload(np.full((128, 128), 500, np.uint16), "depth.png"))
    assert visit.depth.max() == pytest.approx(0.5)
    with pytest.raises(ValueError, match="9 x 9"):
        visit.take_depth(upload(np.full((9, 9), 500, np.uint16), "small.png"))
    command = visit.command("bowl", (600, 600, 63.5, 63.5))
    assert command == "kfit pose mug.png --category bowl --intrinsics 600 600 63.5 63.5 --depth depth.png"
    program = snippet_of("my mug.png", "mug", (600, 600, 63.5, 63.5), "depth.png")
    compile(program, "repeat.py", "exec")
    assert "read_photo('my mug.png')" in program
    assert "depth_from_file('depth.png', image.image.shape[:2])" in program


def test_what_is_still_to_be_given_is_asked_for(visit, upload, drawn_mug):
    for asked in (lambda: visit.fit("mug"), lambda: visit.draw((0.1, 0.1, 0.5, 0.5))):
        with pytest.raises(ValueError, match=r"^There is no picture"):
            asked()
    visit.take(upload(drawn_mug))
    with pytest.raises(ValueError, match=r"^Choose what kind of object it is.$"):
        visit.fit(None)


def test_a_fit_can_be_downloaded_in_all_its_forms(visit, upload, drawn_mug, monkeypatch):
    asked = []

    def report(result, path, command=None):
        asked.append((result.category, command))
        path.write_text("<!doctype html>")
        return path

    monkeypatch.setattr(kfit, "report", report, raising=False)
    visit.take(upload(drawn_mug))
    *drawn, result = visit.fit("mug")
    assert all(isinstance(one, Drawn) for one in drawn)
    assert isinstance(result, PoseResult)
    files = visit.write(result)
    assert asked == [("mug", visit.command("mug"))]
    assert files["report.html"].read_text() == "<!doctype html>"
    assert json.loads(files["pose.json"].read_text()) == json.loads(json.dumps(result.to_dict()))
    assert {path.name for path in visit.folder.iterdir()} == set(files) == set(FILES)
    visit.write(replace(result, surface=None))
    visit.close()
    assert not visit.folder.exists()


def test_a_fit_that_ends_after_the_visit_leaves_no_folder_behind(visit, upload, drawn_mug):
    visit.take(upload(drawn_mug))
    visit.close()
    with pytest.raises(ValueError, match=r"^There is no picture"):
        visit.write(None)
    assert not visit.folder.exists()


def test_sessions_are_apart_and_closing_one_leaves_the_others(tmp_path, upload, drawn_mug):
    visits = Sessions(tmp_path)
    one, two = visits.of("one"), visits.of("two")
    assert visits.of("one") is one
    assert one.folder != two.folder
    one.take(upload(drawn_mug))
    assert two.photo is None
    visits.close("one")
    visits.close("one")
    assert len(visits) == 1
    assert one.photo is None
    assert not one.folder.exists()
    assert two.folder.exists()
    assert visits.of("one") is not one


def test_a_visit_that_comes_back_soon_is_kept(tmp_path, monkeypatch):
    kept = Sessions(tmp_path)
    first = kept.of("one")
    kept.leave("one")
    assert kept.of("one") is first
    monkeypatch.setattr(sessions, "GRACE", 0.01)
    kept.leave("one")
    deadline = time.monotonic() + 10
    while first.folder.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert len(kept) == 0
    assert not first.folder.exists()


def test_the_session_used_longest_ago_makes_room(tmp_path):
    visits = Sessions(tmp_path)
    first = visits.of("0")
    second = visits.of("1")
    for k in range(2, sessions.MOST_SESSIONS):
        visits.of(str(k))
    visits.of("0")
    visits.of("one more")
    assert len(visits) == sessions.MOST_SESSIONS
    assert first.folder.exists()
    assert not second.folder.exists()


def test_sessions_that_wait_for_their_fits_make_no_room(tmp_path):
    visits = Sessions(tmp_path)
    waiting = [visits.of(str(k)) for k in range(4)]
    for one in waiting:
        one.busy = True
    for k in range(4, 50):
        visits.of(str(k))
    assert len(visits) == sessions.MOST_SESSIONS
    assert all(visits.of(str(k)) is one for k, one in enumerate(waiting))


def test_large_photos_make_room_earlier(tmp_path, monkeypatch):
    monkeypatch.setattr(sessions, "MOST_PIXELS", 10_000)
    visits = Sessions(tmp_path)
    first, second = visits.of("0"), visits.of("1")
    first.photo = second.photo = Photo(np.zeros((80, 80, 3), np.float32))
    visits.of("2")
    assert len(visits) == 2
    assert not first.folder.exists()
    assert second.photo is not None

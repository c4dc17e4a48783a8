"""The page in a real browser: picture in, box drawn, fit watched, answer out."""

import json
import re
import shutil
import signal
import urllib.error
import urllib.request
from importlib.util import find_spec

import pytest
from app_process import started

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="there is no chromium on PATH"),
    pytest.mark.skipif(find_spec("gradio") is None, reason="gradio is not installed"),
]


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """Address of a page, and the folder in which the server keeps its files."""
    folder = tmp_path_factory.mktemp("server")
    server, port = started(folder)
    said = []
    for line in server.stderr:
        said.append(line)
        if line.startswith("kfit: open"):
            break
    assert said == [f"kfit: open http://127.0.0.1:{port}/ in a browser; Ctrl-C ends it\n"]
    yield f"http://127.0.0.1:{port}/", folder
    server.send_signal(signal.SIGTERM)
    assert server.wait(30) == 0
    assert server.stderr.read() == ""
    server.stderr.close()
    assert list(folder.iterdir()) == []


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as play:
        launched = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        yield launched
        launched.close()


@pytest.fixture
def visit(browser, served):
    """Opens the page; at the end nothing was asked of anybody but its server."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, has_touch=True)
    context.set_default_timeout(90_000)
    page = context.new_page()
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(served[0])
    page.get_by_text("Take the example").wait_for()
    yield page
    context.close()
    assert asked
    assert [url for url in asked if not url.startswith((served[0], "data:", "blob:"))] == []


def drawings(page):
    """Has the page note each step that it shows."""
    page.evaluate(
        """() => { window.steps = new Set(); new MutationObserver(() => {
        const told = document.querySelector(".kfit-busy");
        if (told?.textContent.startsWith("Step")) window.steps.add(document.querySelectorAll(".kfit-pair img")[1].src);
        }).observe(document.body, {subtree: true, childList: true, characterData: true, attributes: true}); }"""
    )


def test_picture_box_fit_pose_and_downloads(visit, served, upload, drawn_mug, tmp_path):
    visit.locator("input[type=file]").first.set_input_files(upload(drawn_mug[..., :3]))
    stage = visit.locator(".kfit-stage")
    stage.wait_for()
    room = stage.bounding_box()
    rows, columns = ((drawn_mug[..., 3] > 0).any(axis).nonzero()[0] for axis in (1, 0))
    across, down = room["width"] / 128, room["height"] / 128
    visit.mouse.move(room["x"] + columns[0] * across, room["y"] + rows[0] * down)
    visit.mouse.down()
    visit.mouse.move(room["x"] + 64 * across, room["y"] + 64 * down)
    assert visit.locator(".kfit-box").is_visible()
    visit.mouse.move(room["x"] + (columns[-1] + 1) * across, room["y"] + (rows[-1] + 1) * down)
    visit.mouse.up()
    visit.locator(".kfit-mask").wait_for()
    visit.get_by_role("button", name="Fit", exact=True).click()
    visit.get_by_text("Choose what kind of object it is.").wait_for()
    visit.get_by_label("mug").check()
    drawings(visit)
    visit.get_by_role("button", name="Fit", exact=True).click()
    visit.locator(".kfit-answer").wait_for()
    assert visit.locator(".kfit-answer").inner_text().startswith("Mug ")
    assert "Focal length estimated" in visit.locator(".kfit-notes").inner_text()
    assert visit.evaluate("window.steps.size") > 3
    for name, file in (("Numbers (JSON)", "pose.json"), ("Report (HTML)", "report.html")):
        with visit.expect_download() as download:
            visit.get_by_text(name).click()
        download.value.save_as(tmp_path / file)
    assert json.loads((tmp_path / "pose.json").read_text())["category"] == "mug"
    box = re.search(r"kfit pose mug.png --category mug --box (\d+) (\d+)", (tmp_path / "report.html").read_text())
    assert all(abs(int(a) - b) <= 1 for a, b in zip(box.groups(), (columns[0], rows[0]), strict=True))
    visit.screenshot(path=tmp_path / "answer.png", full_page=True)
    # On the disk is what can be downloaded, and of the photo nothing.
    kept = {path.name for path in served[1].rglob("*") if path.is_file() and path.stat().st_size}
    assert kept == {"pose.json", "report.html"}


def test_two_taps_draw_a_box_on_the_example_and_another_photo_can_follow(visit):
    visit.get_by_text("Take the example").click()
    visit.locator(".kfit-mask").wait_for()
    assert visit.get_by_label("mug").is_checked()
    by_hand = visit.locator(".kfit-mask").get_attribute("src")
    room = visit.locator(".kfit-stage").bounding_box()
    for x, y in ((170, 15), (412, 312)):
        visit.touchscreen.tap(room["x"] + x / 600 * room["width"], room["y"] + y / 400 * room["height"])
    sync_api.expect(visit.locator(".kfit-mask")).not_to_have_attribute("src", by_hand)
    visit.get_by_text("Another photo").click()
    visit.get_by_text("Take the example").wait_for()
    assert visit.locator(".kfit-stage").count() == 0


def test_a_mistake_is_one_sentence_in_the_page(visit, tmp_path):
    path = tmp_path / "notes.png"
    path.write_text("no picture")
    visit.locator("input[type=file]").first.set_input_files(path)
    visit.get_by_text("notes.png is no JPEG, PNG, WebP, AVIF or HEIC picture, which the page takes").wait_for()
    assert "Traceback" not in visit.content()
    visit.get_by_text("Take the example").wait_for()


def test_a_name_that_a_stranger_points_at_this_machine_is_refused(served):
    request = urllib.request.Request(served[0], headers={"Host": "example.org"})
    with pytest.raises(urllib.error.HTTPError, match="400") as refused:
        urllib.request.urlopen(request)
    refused.value.close()

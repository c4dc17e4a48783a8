"""The page in a real browser: example or picture in, fit watched, answer turned and downloaded."""

import json
import re
import shutil
import signal
import urllib.error
import urllib.request
from importlib.util import find_spec

import pytest
from app_process import started

from kfit.app.downloads import FILES

# A random number that ONNX Runtime leaves in the folder of temporary files when it is imported.
SESSION = ".ses"
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
    lines = []
    for line in server.stderr:
        lines.append(line)
        if line.startswith("kfit: open"):
            break
    assert lines == [f"kfit: open http://127.0.0.1:{port}/ in a browser; Ctrl-C ends it\n"]
    yield f"http://127.0.0.1:{port}/", folder
    server.send_signal(signal.SIGTERM)
    assert server.wait(30) == 0
    left = server.stderr.read()
    server.stderr.close()
    # Gradio reports an error of its own when a run ends while it is being cancelled.
    assert left == "" or ("in cancel_event" in left and left.count("Traceback") == 1)
    assert [path.name for path in folder.iterdir() if path.name != SESSION] == []


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
    page.get_by_text("A cup of coffee").wait_for()
    yield page
    context.close()
    assert asked
    assert [url for url in asked if not url.startswith((served[0], "data:", "blob:"))] == []


def take_coffee(visit):
    """Presses the first example, whose fit begins by itself, and stops the fit."""
    visit.get_by_role("button", name="A cup of coffee").click()
    visit.get_by_role("button", name="Stop").click()
    visit.get_by_role("button", name="Fit", exact=True).wait_for()
    visit.locator(".kfit-mask").wait_for()


def drawings(page):
    """Has the page note each step that it shows."""
    page.evaluate(
        """() => { window.steps = new Set(); new MutationObserver(() => {
        const live = document.querySelector(".kfit-live");
        if (live) window.steps.add(live.src);
        }).observe(document.body, {subtree: true, childList: true, characterData: true, attributes: true}); }"""
    )


def contrast(visit, selector):
    """Ratio of luminances of an element's text and what is behind it (WCAG 2)."""
    return visit.locator(selector).first.evaluate(
        """async (element) => {
        // Colours change gradually, also those behind the element.
        const changing = document.getAnimations().filter((one) => one.effect.target.contains(element));
        await Promise.all(changing.map((one) => one.finished));
        const parse = (text) => (text.match(/[\\d.]+/g) || []).map(Number);
        const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
          .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
          .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
        let behind = element;
        while (behind && (parse(getComputedStyle(behind).backgroundColor)[3] ?? 1) === 0) behind = behind.parentElement;
        const [a, b] = [light(parse(getComputedStyle(element).color)),
                        light(parse(getComputedStyle(behind || document.body).backgroundColor))];
        return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        }"""
    )


def test_an_example_is_answered_turned_and_downloaded(visit, served, tmp_path):
    assert visit.locator(".kfit-card img").count() == 4
    drawings(visit)
    visit.get_by_role("button", name="A cup of coffee").click()
    visit.locator(".kfit-answer").wait_for()
    assert visit.evaluate("window.steps.size") > 3
    assert re.match(
        r"Mug seen from \d+° above, handle .*; \d+ × \d+ × \d+ cm, about \d+ cm away\.",
        visit.locator(".kfit-answer").inner_text(),
    )
    assert "within 20°" in visit.locator(".kfit-sure").inner_text()
    assert visit.locator("[aria-current=step]").inner_text().endswith("Answer")
    canvas = visit.locator(".kfit-space canvas")
    canvas.scroll_into_view_if_needed()
    before, room = canvas.get_attribute("data-azimuth"), canvas.bounding_box()
    picture = canvas.screenshot()
    visit.mouse.move(room["x"] + 100, room["y"] + 100)
    visit.mouse.down()
    visit.mouse.move(room["x"] + 200, room["y"] + 110)
    visit.mouse.up()
    assert int(canvas.get_attribute("data-azimuth")) == int(before) + 50
    visit.wait_for_timeout(300)
    assert canvas.screenshot() != picture
    canvas.focus()
    visit.keyboard.press("ArrowLeft")
    assert int(canvas.get_attribute("data-azimuth")) == int(before) + 40
    for name, file in FILES.items():
        with visit.expect_download() as download:
            visit.get_by_text(file, exact=True).click()
        download.value.save_as(tmp_path / name)
    assert json.loads((tmp_path / "pose.json").read_text())["category"] == "mug"
    assert "--category mug --mask mask.png" in (tmp_path / "report.html").read_text()
    assert (tmp_path / "mesh.glb").read_bytes().startswith(b"glTF")
    compile((tmp_path / "repeat.py").read_text(), "repeat.py", "exec")
    # On the disk is what can be downloaded, and of the photo nothing.
    kept = {path.name for path in served[1].rglob("*") if path.is_file() and path.stat().st_size}
    assert kept - {SESSION} == set(FILES)
    # What was answered before is gone when what it rests on changes.
    visit.get_by_label("bowl").check()
    sync_api.expect(visit.locator(".kfit-answer")).to_have_count(0)
    sync_api.expect(visit.locator(".kfit-space canvas")).to_have_count(0)


def test_a_photo_gets_a_box_and_a_mask_that_a_brush_corrects_and_a_reload_keeps_it(visit, upload, drawn_mug):
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
    by_box = visit.locator(".kfit-mask").get_attribute("src")
    visit.get_by_role("button", name="Remove from it").click()
    room = stage.bounding_box()
    visit.mouse.move(room["x"] + 64 * across, room["y"] + 30 * down)
    visit.mouse.down()
    visit.mouse.move(room["x"] + 64 * across, room["y"] + 90 * down)
    visit.mouse.up()
    sync_api.expect(visit.locator(".kfit-mask")).not_to_have_attribute("src", by_box)
    corrected = visit.locator(".kfit-mask").get_attribute("src")
    visit.reload()
    sync_api.expect(visit.locator(".kfit-mask")).to_have_attribute("src", corrected)


def test_two_taps_draw_a_box_on_the_example_and_another_photo_can_follow(visit):
    take_coffee(visit)
    assert visit.get_by_label("mug").is_checked()
    by_hand = visit.locator(".kfit-mask").get_attribute("src")
    room = visit.locator(".kfit-stage").bounding_box()
    for x, y in ((170, 15), (412, 312)):
        visit.touchscreen.tap(room["x"] + x / 600 * room["width"], room["y"] + y / 400 * room["height"])
    sync_api.expect(visit.locator(".kfit-mask")).not_to_have_attribute("src", by_hand)
    visit.get_by_text("Another photo").click()
    visit.get_by_text("A cup of coffee").wait_for()
    assert visit.locator(".kfit-stage").count() == 0


def test_a_mistake_is_one_sentence_where_the_problem_is(visit, tmp_path):
    path = tmp_path / "notes.png"
    path.write_text("no picture")
    visit.locator("input[type=file]").first.set_input_files(path)
    problem = visit.get_by_role("alert").filter(has_text="notes.png is no JPEG")
    problem.wait_for()
    assert visit.locator(".toast-body").count() == 0
    assert "Traceback" not in visit.content()
    take_coffee(visit)
    sync_api.expect(problem).to_have_count(0)
    visit.get_by_text("Camera and depth").click()
    visit.get_by_label("Intrinsics in pixels").fill("600 600")
    visit.get_by_role("button", name="Fit", exact=True).click()
    visit.get_by_role("alert").filter(has_text="The camera must be four numbers").wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_needs_no_sideways_scrolling_and_text_can_be_read(visit, scheme):
    visit.emulate_media(color_scheme=scheme)
    visit.wait_for_function("(dark) => document.body.classList.contains('dark') === dark", arg=scheme == "dark")
    visit.set_viewport_size({"width": 390, "height": 844})
    for selector in (".kfit-head p", ".kfit-steps [aria-current]", ".or", ".kfit-or", ".kfit-card span"):
        assert contrast(visit, selector) >= 4.5, selector
    assert visit.evaluate("document.documentElement.scrollWidth") <= 390
    visit.get_by_role("button", name="A cup of coffee").click()
    visit.locator(".kfit-live").wait_for()
    sync_api.expect(visit.locator(".kfit-live")).to_be_in_viewport(ratio=0.9)
    visit.get_by_role("button", name="Stop").click()
    visit.get_by_role("button", name="Fit", exact=True).wait_for()
    assert contrast(visit, "button.primary") >= 4.5
    assert visit.evaluate("document.documentElement.scrollWidth") <= 390
    unnamed = visit.evaluate(
        """() => [...document.querySelectorAll("button, input:not([type=hidden])")]
        .filter((one) => one.offsetParent && !(one.innerText || one.getAttribute("aria-label") || one.labels?.length))
        .map((one) => one.outerHTML.slice(0, 120))"""
    )
    assert unnamed == []
    visit.get_by_role("button", name="Draw a box").focus()
    outline = visit.evaluate("getComputedStyle(document.activeElement).outlineWidth")
    visit.keyboard.press("Tab")
    assert "3px" in (outline, visit.evaluate("getComputedStyle(document.activeElement).outlineWidth"))


def test_a_name_that_a_stranger_points_at_this_machine_is_refused(served):
    request = urllib.request.Request(served[0], headers={"Host": "example.org"})
    with pytest.raises(urllib.error.HTTPError, match="400") as refused:
        urllib.request.urlopen(request)
    refused.value.close()

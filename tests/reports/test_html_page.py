from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import torch
from fitted import KEPT, PRUNED_AT, STARTS, STEPS, fitted_mug

import kfit
from kfit.callbacks import Pruning
from kfit.core import Observation
from kfit.geometry import CATEGORIES
from kfit.pose.observed_object import ObservedObject as ObservedObject
from kfit.reports.fit_frames import fit_frames
from kfit.reports.html_page import number, page
from kfit.reports.scene import scene
from kfit.reports.words import words_of

NASTY = "<script>alert('1')</script> & <b>bold</b>"


class Tags(HTMLParser):
    """All tags with their attributes, and the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.found if name == tag]


@pytest.fixture(scope="module")
def text() -> str:
    return page(fitted_mug(), "kfit pose mug.png --category mug")


@pytest.fixture(scope="module")
def tags(text: str) -> Tags:
    return Tags(text)


def test_the_page_asks_for_nothing_from_elsewhere(text: str, tags: Tags) -> None:
    addresses = [
        value for _, attributes in tags.found for name, value in attributes.items() if name in ("src", "href", "srcset")
    ]
    assert len(addresses) == 1 + 1 + STEPS + 1  # the photo, the crop and the drawings
    assert all(address is not None and address.startswith("data:image/") for address in addresses)
    assert not tags.of("link")
    assert not re.search(r"@import|url\((?!#)", text)
    assert all(link is not None and link.startswith("#") for use in tags.of("use") for link in [use["xlink:href"]])
    (policy,) = (meta["content"] for meta in tags.of("meta") if meta.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    assert policy.startswith("default-src 'none'; img-src data:;")


def test_every_picture_says_what_it_shows(tags: Tags) -> None:
    alts = [image["alt"] for image in tags.of("img")]
    plots = [(svg["role"], svg["aria-label"]) for svg in tags.of("svg")]
    assert all(alts)
    assert len(set(alts)) == len(alts)
    assert [role for role, _ in plots] == ["img", "img"]
    assert f"{STARTS} starts, of which 2 were given up" in str(plots[0][1])
    assert "Sphere of views about the object: seen from " in str(plots[1][1])


def test_the_slider_has_a_frame_for_each_step_and_begins_at_the_answer(tags: Tags) -> None:
    frames = [image for image in tags.of("img") if image.get("class") == "frame"]
    (slider,) = tags.of("input")
    assert len(frames) == STEPS + 1
    assert (slider["min"], slider["max"]) == ("0", str(STEPS))
    shown = [step for step, frame in enumerate(frames) if "hidden" not in frame]
    assert shown == [int(str(slider["value"]))]
    assert str(frames[shown[0]]["data-said"]).endswith("the answer")
    assert {label["for"] for label in tags.of("label")} == {slider["id"]}


def test_headings_and_sections_tell_the_structure(tags: Tags) -> None:
    headings = [name for name, _ in tags.found if re.fullmatch(r"h\d", name)]
    assert headings[0] == "h1"
    assert headings.count("h1") == 1
    ids = [attributes["id"] for _, attributes in tags.found if "id" in attributes]
    assert len(set(ids)) == len(ids)
    assert all(section["aria-labelledby"] in ids for section in tags.of("section"))
    assert [meta["content"] for meta in tags.of("meta") if meta.get("name") == "viewport"] == [
        "width=device-width, initial-scale=1"
    ]
    assert "prefers-color-scheme: dark" in tags.text


def test_numbers_have_units_and_the_makers_are_named(tags: Tags) -> None:
    result = fitted_mug()
    for part in result.quaternion_wxyz:
        assert number(part, 4) in tags.text
    for part in (*result.translation, *result.size):
        assert f"{number(100 * part, 1)} cm" in tags.text
    assert f"{100 * result.confidence:.1f} %" in tags.text
    assert all(name in tags.text for name in ("perceptual", "ssim", "silhouette", "prior", "pose"))
    assert "kfit pose mug.png --category mug" in tags.text
    assert f"kfit {kfit.__version__} · torch {torch.__version__} · Python 3." in tags.text


def test_text_from_outside_is_escaped() -> None:
    text = page(replace(fitted_mug(), notes=[NASTY]), NASTY)
    tags = Tags(text)
    assert NASTY not in text
    assert tags.text.count(NASTY) == 2
    assert json.loads(re.findall(r'id="json">(.*?)</script>', text)[0])["notes"] == [NASTY]
    assert [script.get("type") for script in tags.of("script")] == ["application/json", None]
    assert not tags.of("b")


def test_the_answer_is_in_the_words_of_the_command_line(tags: Tags) -> None:
    words = words_of(fitted_mug())
    for part in (words.view, words.size, words.distance, words.confidence, words.meaning):
        assert part in tags.text
    assert "handle" in words.view
    assert "handle" not in words_of(fitted_mug("can")).view


def test_the_3d_view_has_mesh_box_and_a_camera_for_each_alternative(text: str) -> None:
    result = fitted_mug()
    made = scene(result)
    assert np.linalg.norm(made["size"]) == pytest.approx(1, abs=1e-3)
    vertices = np.frombuffer(base64.b64decode(made["mesh"]["vertices"]), "<i2").reshape(-1, 3) / 32767
    faces = np.frombuffer(base64.b64decode(made["mesh"]["faces"]), "<u4")
    mesh = result.mesh()
    np.testing.assert_allclose(vertices * np.linalg.norm(result.size), mesh.vertices, atol=1e-5)
    assert faces.tolist() == mesh.faces.ravel().tolist()
    assert len(made["views"]) == len(result.alternatives)
    camera = -result.rotation.T @ result.translation
    place = np.array(made["views"][0]["place"])
    assert place @ camera == pytest.approx(np.linalg.norm(place) * np.linalg.norm(camera), rel=1e-3)
    assert json.dumps(made["views"][0]["place"]) in text
    assert scene(replace(result, surface=None))["mesh"] is None


def test_report_writes_the_page_and_tells_where(tmp_path: Path) -> None:
    place = kfit.report(fitted_mug(), tmp_path / "new" / "out.html")
    assert place == tmp_path / "new" / "out.html"
    assert place.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert [path.name for path in place.parent.iterdir()] == ["out.html"]


@pytest.mark.slow
def test_an_answer_from_a_fit_of_several_objects_has_a_page_of_its_own() -> None:
    alone = fitted_mug()
    model, found = kfit.load("mug"), fitted_mug().observation
    other = Observation(found.field("image").flip(3), found.field("mask").flip(3))
    both = Observation(
        *(torch.cat([one.field(name) for one in (other, found)]) for name in ("image", "mask")),
        intrinsics=found.field("intrinsics").repeat(2, 1, 1),
        keys=(1, 0),
    )
    observed = ObservedObject.of(alone.image, CATEGORIES["mug"], 64, mask=alone.mask)
    pipeline = model.pipeline(STARTS, STEPS, [Pruning({PRUNED_AT: KEPT})])
    answers = model.answers(pipeline(both, seed=0), [observed, observed], both)
    assert answers[1] is not None
    frames, expected = fit_frames(answers[1]), fit_frames(alone)
    assert frames.energy == pytest.approx(expected.energy, rel=1e-3)
    assert Tags(page(answers[1])).text.count("start") == Tags(page(alone)).text.count("start")


def test_numbers_have_a_true_minus_and_no_negative_zero() -> None:
    assert [number(value, 1) for value in (-12.34, -0.01, 3.0, float("nan"))] == ["−12.3", "0.0", "3.0", "–"]

"""`kfit pose` with a page and an animation beside its answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage.io import imsave

from kfit.cli import pose
from kfit.cli.main import main
from kfit.data import build, pose_view


@pytest.fixture(scope="module")
def cutout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh, light = build("mug", 7)
    view = pose_view(mesh, 0.5, 0.6, light, 128)
    pixels = np.concatenate([view.image, view.mask[..., None]], 2)
    path = tmp_path_factory.mktemp("photos") / "my mug.png"
    imsave(path, (255 * pixels).round().astype(np.uint8), check_contrast=False)
    return path


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.slow
def test_page_and_animation_are_written_where_they_are_asked_for(
    cutout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["pose", str(cutout), "--category", "mug", "--report", "page.html", "--animation", "moving/fit.gif"])
    assert files(tmp_path) == ["kfit_out/overlay.png", "kfit_out/pose.json", "moving/fit.gif", "page.html"]
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "my mug.png&#39; --category mug --report page.html --animation moving/fit.gif</code>" in text
    with Image.open(tmp_path / "moving/fit.gif") as moving:
        assert moving.n_frames == 17


@pytest.mark.slow
def test_open_shows_a_page_that_nobody_named(cutout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []
    monkeypatch.setattr("kfit.runtime.browser.open_files", opened.extend)
    monkeypatch.chdir(tmp_path)
    main(["pose", str(cutout), "--category", "mug", "--open"])
    assert opened == [Path("kfit_out/report.html")]
    assert "kfitScene" in opened[0].read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--report", "page.pdf"], "--report must name an .html file, got 'page.pdf'"),
        (["--animation", "fit.avi"], "animation must be a .gif or .mp4 file, got 'fit.avi'"),
    ],
)
def test_another_suffix_is_refused_before_anything_is_fitted(
    cutout: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(["pose", str(cutout), "--category", "mug", *words])
    assert capsys.readouterr().err == f"kfit: {sentence}\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_all_files_are_written_or_none(cutout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(result: object, path: Path) -> None:
        raise OSError("no space left")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("kfit.reports.animation.animate", fails)
    with pytest.raises(SystemExit):
        main(["pose", str(cutout), "--category", "mug", "--report", "page.html", "--animation", "fit.gif"])
    assert files(tmp_path) == []


def test_the_reported_command_can_be_run() -> None:
    words = ["my mug.png", "--category", "mug", "--box", "1", "2", "30.5", "40", "--json"]
    assert pose.command(pose.parser().parse_args(words)) == (
        "kfit pose 'my mug.png' --category mug --box 1 2 30.5 40 --json"
    )
    words = ["a.png", "b.png", "--mask", "c.png", "--mask", "d.png", "--relative-poses", "p.json"]
    assert pose.command(pose.parser().parse_args(words)) == f"kfit pose {' '.join(words)}"

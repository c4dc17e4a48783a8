"""`kfit bench speed`: what is counted, kept and gone on with."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from tiny_model import TINY, write_tiny

from kfit.bench import speed as bench_speed
from kfit.bench.speed_page import sections
from kfit.cli.main import main
from kfit.runtime.devices import Operations, matrix_rate

ROOT = Path(__file__).parents[2]


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """A bottle's model file, small and untrained, with a pose head."""
    sizes = {"code_dim": 4, "volume_dims": [8, 4, 4], "projection_dim": 8, "decoder_dims": [8, 4]}
    networks = {
        **TINY,
        "generator": {"class_path": "kfit.generators.VAE3D", "init_args": sizes},
        "pose_head": {"class_path": "kfit.generators.PoseHead", "init_args": {}},
    }
    return write_tiny(tmp_path / "tiny.safetensors", "bottle", networks)


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    """The released fit with features that are at hand, three starts and two steps."""
    lines = (ROOT / "recipes/fit_released.yaml").read_text().splitlines()
    kept = [line for line in lines if "layers: [conv3_3]" not in line]
    text = "\n".join(kept).replace("kfit.features.VGG19", "kfit.features.EfficientNetLite0")
    text = text.replace("num_starts: 32", "num_starts: 3").replace("num_steps: 50", "num_steps: 2")
    (tmp_path / "fit.yaml").write_text(text)
    return tmp_path / "fit.yaml"


@pytest.mark.slow
def test_each_fit_is_kept_and_none_is_measured_twice(
    tiny: Path, recipe: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_speed, "profiles", lambda ways, views: {})
    out = tmp_path / "out"
    words = ["bench", "speed", "--model", str(tiny), "--recipe", str(recipe), "--out", str(out)]
    words += ["--views", "2", "--timed", "1", "--repeats", "2"]
    main(words)
    printed = capsys.readouterr().out
    saved = json.loads((out / "speed.json").read_text())
    fits = saved["found"]["fits"]
    assert list(fits) == ["released", "kfit, released energy", "kfit", "kfit, bundled model"]
    assert {name: [len(fits[name][number]) for number in "01"] for name in fits} == {name: [2, 1] for name in fits}
    # Three starts at each of two steps and the last look; 16 candidates, 4 rows at steps 0 to 3, 2 at 4 to 16.
    assert [fits[name]["0"][0]["pictures"] for name in fits] == [9, 58, 58, 58]
    assert "energy: released" in fits["kfit"]["0"][0]
    assert "energy: released" not in fits["kfit, bundled model"]["0"][0]
    assert "What a view costs" in printed
    assert "kfit bench speed --model" in (out / "README.md").read_text()

    del fits["kfit"]["1"]  # as if stopped before the last
    (out / "speed.json").write_text(json.dumps(saved))
    again: list[str] = []
    fit = bench_speed.fit
    monkeypatch.setattr(bench_speed, "fit", lambda way, *args: (again.append(way.name), fit(way, *args))[1])
    main(words)
    assert again == ["kfit"]

    with pytest.raises(SystemExit):
        main([*words, "--seed", "3"])
    assert "was measured with other settings" in capsys.readouterr().err


def test_ratios_are_medians_over_repeats() -> None:
    def fits(seconds: list[float], pictures: int) -> dict[str, list[dict[str, object]]]:
        calls = [
            {"seconds": s, "pictures": pictures, "megabytes": None, "rotation_deg": 3.0, "energy: released": s}
            for s in seconds
        ]
        return {"0": calls}

    cost, quality = sections({"released": fits([40, 30, 20], 1600), "kfit": fits([1, 2, 1], 80)}, 1, {}, {})
    assert cost.rows[1] == ["kfit", "1.00", "20.0 ×", "80", "20.0 ×", "unknown", ""]
    assert quality.rows[1] == ["kfit", "3.0°", "100 %", "100 %", "100 %", "100 %", "1 (1)"]


def test_operations_of_products_and_convolutions_are_counted() -> None:
    with Operations() as counted:
        torch.ones(3, 4) @ torch.ones(4, 5)
        picture = torch.ones(1, 2, 6, 6, requires_grad=True)
        found = torch.nn.functional.conv2d(picture, torch.ones(3, 2, 3, 3))
        torch.autograd.grad(found.sum(), picture)
    assert counted.total == 2 * 3 * 4 * 5 + 2 * 2 * (2 * 3 * 9 * 16)  # forwards and back to the picture


def test_the_machines_rate_is_a_number() -> None:
    assert matrix_rate(torch.float32, size=64, repeats=1) > 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--views", "0"], "--views must be at least 1"),
        (["--views", "2", "--timed", "3"], "--timed must be at most --views"),
        (["--device", "nonsense"], "cannot be used here"),
        (["--recipe", "gone.yaml"], "there is no recipe gone.yaml"),
    ],
)
def test_a_users_mistake_gets_one_sentence(
    tiny: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["bench", "speed", "--model", str(tiny), *words])
    assert message in capsys.readouterr().err

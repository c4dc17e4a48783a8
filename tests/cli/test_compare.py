"""`kfit compare`: tables and curves of trainings by their folders."""

import pytest

from kfit.cli.main import main


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for number, (rate, errors) in enumerate([(0.1, (3.0, 1.0, 2.0)), (0.2, (4.0, 3.0, 2.5))]):
        folder = tmp_path / f"version_{number}"
        folder.mkdir()
        (folder / "config.yaml").write_text(f"model:\n  init_args: {{rate: {rate}, depth: 3}}\nseed_everything: 0\n")
        rows = "".join(f"{step},{0.1 * error},,{error},{step}\n" for step, error in enumerate(errors))
        (folder / "metrics.csv").write_text(f"epoch,val/within_10deg,train/loss,val/l1,step\n{rows}")
    return tmp_path


def test_recipes_and_results_stand_side_by_side(runs, capsys):
    main(["compare", "version_0", "version_1", "--curves", "curves.png"])
    text = capsys.readouterr().out
    assert "model.init_args.rate" in text
    assert "model.init_args.depth" not in text
    assert "2 (1)" in text  # less of an error is better
    assert "0.2 (0.3)" in text  # more of a share is
    assert (runs / "curves.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "nowhere is no folder of a training: it has no metrics.csv"),
        (["."], "its folders version_0, version_1 have"),
        (["version_0", "--curves", "c.gif"], "--curves must name a .png, .svg or .pdf file"),
    ],
)
def test_what_cannot_be_compared_gets_a_sentence(runs, capsys, words, message):
    with pytest.raises(SystemExit) as ended:
        main(["compare", *words])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_a_table_that_is_none_of_lightning_s_names_itself(runs, capsys):
    (runs / "version_0" / "metrics.csv").write_text("step,val/l1\n0,much\n")
    with pytest.raises(SystemExit):
        main(["compare", "version_0"])
    assert "val/l1 has 'much'" in capsys.readouterr().err


def test_brackets_in_names_and_values_are_printed(runs, capsys):
    (runs / "version_0").rename(runs / "[mug]")
    config = runs / "[mug]" / "config.yaml"
    config.write_text(config.read_text() + "categories: [mug, can]\n")
    main(["compare", "[mug]", "version_1"])
    text = capsys.readouterr().out
    assert text.count("[mug]") == 2
    assert "['mug', 'can']" in text

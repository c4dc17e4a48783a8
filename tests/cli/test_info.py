import json
from email.message import Message

import pytest
from model_file import card_of
from safetensors.numpy import load_file

from kfit import __version__
from kfit.cli import info
from kfit.cli.main import main


def test_json_is_pure_and_tells_what_cards_and_weights_tell(capsys):
    main(["info", "--json"])
    out, err = capsys.readouterr()
    assert err == ""
    printed = json.loads(out)
    assert set(printed) == {"versions", "devices", "models", "caches", "extras"}
    assert printed["versions"]["kfit"] == __version__
    assert printed["devices"][0]["device"] == "cpu"
    assert printed["devices"][0]["threads"] >= 1
    assert [model["category"] for model in printed["models"]] == ["bottle", "bowl", "camera", "can", "laptop", "mug"]
    mug = printed["models"][-1]
    assert mug["parameters"] == sum(numbers.size for numbers in load_file(info.BUNDLED / "mug.safetensors").values())
    card = card_of(info.BUNDLED / "mug.safetensors")
    views = card["accuracy"]["unseen procedural objects, held-out families, upright views"]["all views"]
    assert mug["median_rotation_error_deg"] == views["median"]
    assert mug["under_10_deg"] == views["under_10"]
    assert not mug["symmetric"]
    assert mug["calibrated"] == list(card["calibration"])


def test_tables_name_devices_models_caches_and_extras(capsys):
    main(["info"])
    out = capsys.readouterr().out
    for title in ("Versions", "Devices", "Models", "Caches", "Extras"):
        assert title in out
    assert "laptop" in out
    assert ".kfit_cache" in out


def test_the_table_of_extras_names_the_extra_to_install(monkeypatch, capsys):
    monkeypatch.setattr(info, "_version", lambda name: None)
    info.show(info.sections({"versions": {}, "devices": [], "models": [], "caches": [], "extras": info.extras()}), 100)
    assert "pip install 'kfit[export]'" in capsys.readouterr().out


def test_caches_are_measured(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".kfit_cache/deep").mkdir(parents=True)
    (tmp_path / ".kfit_cache/deep/views.h5").write_bytes(bytes(3 * 2**20))
    views = info.caches()[0]
    assert views["folder"] == str(tmp_path / ".kfit_cache")
    assert views["mib"] == 3


@pytest.mark.parametrize("there", [True, False])
def test_an_extra_tells_what_it_lacks_and_how_it_is_installed(there, monkeypatch):
    monkeypatch.setattr(info, "_version", lambda name: "1.0" if there or name != "onnxscript" else None)
    found = {one["extra"]: one for one in info.extras()}
    assert found["export"]["installed"] is there
    assert found["export"]["lacks"] == ([] if there else ["onnxscript"])
    assert found["export"]["by"] == "pip install 'kfit[export]'"


def test_an_extra_that_holds_others_lacks_what_they_lack(monkeypatch):
    about = Message()
    for line in ("onnxscript; extra == 'export'", "gone; extra == 'app'", "kfit[app,export]; extra == 'all'"):
        about["Requires-Dist"] = line
    for extra in ("app", "export", "all"):
        about["Provides-Extra"] = extra
    monkeypatch.setattr(info.metadata, "metadata", lambda name: about)
    monkeypatch.setattr(info, "_version", lambda name: None if name == "gone" else "1.0")
    found = {one["extra"]: one for one in info.extras()}
    assert found["export"]["installed"]
    assert found["all"]["lacks"] == ["gone"]

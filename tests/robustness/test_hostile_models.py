"""Model files and checkpoints of strangers: what they name is kfit's own, and what they ask for is what they hold."""

from __future__ import annotations

import copy
import json
import pickle
import struct
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from model_file import card_of, put_card

from kfit.models import load
from kfit.models.load import BUNDLED
from kfit.pose import Card
from kfit.pose.model_files import read_checkpoint
from kfit.runtime.torch_file import LARGEST_WEIGHTS, read_torch

MUG = BUNDLED / "mug.safetensors"
CARD = card_of(MUG)
WRONG: list[Any] = [
    *(None, True, -1, 10**9, 10**30, 1e308, float("nan"), float("inf")),
    *("../x", "/etc/passwd", "\x1b[31m", [], ["a"], [[[]]]),
]
# Entries for people to read, of which nothing depends on.
FREE = ("training", "accuracy", "measured")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return tmp_path / "m.safetensors"


def entries(value: Any, above: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, below in inner:
        yield (*above, key)
        if key not in FREE:
            yield from entries(below, (*above, key))


def changed(place: tuple[str | int, ...], value: Any) -> dict[str, Any]:
    card = copy.deepcopy(CARD)
    room: Any = card
    for key in place[:-1]:
        room = room[key]
    room[place[-1]] = value
    return card


def refused(read: Callable[[Path], Any], path: Path) -> str:
    with pytest.raises(ValueError, match=r".") as error:
        read(path)
    sentence = str(error.value)
    assert len(sentence) < 700
    assert sentence.isprintable()
    return sentence


@pytest.mark.slow
def test_whatever_stands_in_an_entry_of_a_card_is_taken_or_gets_a_sentence(tmp_path: Path) -> None:
    path, taken = tmp_path / "m.safetensors", 0
    for place in entries(CARD):
        for value in WRONG:
            text = json.dumps(changed(place, value))
            try:
                card = Card.of_json(text, path)
            except ValueError:
                assert refused(partial(Card.of_json, text), path)
            else:
                assert card.symmetry in ("none", "y")
                assert 0 < card.mean_diagonal < 1e5
                taken += 1
    assert taken


@pytest.mark.parametrize(
    "name", ["distance", "unit_fraction", "elevation_deg", "symmetry", "mean_diagonal", "networks"]
)
def test_an_entry_that_fits_rest_on_is_checked(name: str, model: Path) -> None:
    for value in (None, float("nan"), -1e9, "x", ["a"], {"a": 1}):
        put_card(model, changed((name,), value), MUG)
        assert "m.safetensors holds a model card that cannot be used: " in refused(load, model)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "recursion"),
        ("9" * 5000, "digits"),
        ("{" + " " * 10_000_000, "more than 10,000,000"),
        ('{"category": []}', "must have just"),
    ],
)
def test_a_card_that_is_none_gets_a_sentence(text: str, message: str, model: Path) -> None:
    put_card(model, text, MUG)
    assert message in refused(load, model)
    model.write_bytes(weights({}, b""))
    model.with_suffix(".json").write_text(text)  # where version 0.1 kept it
    assert message in refused(load, model)


@pytest.mark.parametrize(
    ("class_path", "arguments"),
    [
        ("os.system", {"command": "touch executed"}),
        ("subprocess.Popen", {"args": "x"}),
        ("builtins.open", {"file": "executed", "mode": "w"}),
        ("torch.load", {"f": "x"}),
        ("torch.nn.Linear", {"in_features": 10**6, "out_features": 10**4}),
        ("kfit.features.VGG16", {}),  # fetches half a gigabyte
        ("kfit.generators.OnnxGenerator", {"path": "/etc/passwd"}),
        ("kfit.generators.MeshRenderer", {}),
        ("kfit.generators.PoseHead", {}),
        ("kfit.generators.radiance_field.RadianceField", {}),
        ("../../x.y", {}),
        ("\x1b]8;;http://x\x07.y\x00", {}),
        ("x" * 10**6, {}),
    ],
)
def test_only_kfit_s_own_networks_are_built(class_path: str, arguments: dict[str, Any], model: Path) -> None:
    named = {"class_path": class_path, "init_args": arguments}
    put_card(model, changed(("networks", "generator"), named), MUG)
    assert "as generator: no network of kfit" in refused(load, model)


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("RadianceField", {"volume_dims": [4096, 4096, 4096]}, "far larger than its file"),
        ("RadianceField", {"volume_dims": [1] * 10**5}, "number of volume_dims must lie between 0 and 6"),
        ("RadianceField", {"code_dim": 5000}, "code_dim must be at most 4096 in a file, got 5000"),
        ("RadianceField", {"image_size": 1025, "num_samples": 1}, "image_size in a file must lie between 1 and 1024"),
        (
            "RadianceField",
            {"image_size": 1024, "num_samples": 1024},
            "image_size² · num_samples in a file must lie between",
        ),
        ("VAE3D", {"projection_dim": 4096, "volume_dims": [4096] * 5}, "far larger than its file"),
        ("VAE3D", {"decoder_dims": [1] * 30}, "number of decoder_dims must lie between 0 and 9"),
        ("VAE3D", {"decoder_dims": [1] * 8}, "image_size in a file must lie between 1 and 1024, got 4096"),
        ("VAE2D", {"decoder_dims": [[[[[]]]]]}, "must be a whole number"),
        ("VAE2D", {"beyond": 1}, "unexpected keyword argument"),
        ("VAE2D", [1], "must be a mapping"),
    ],
)
def test_a_network_is_built_no_larger_than_its_numbers_fill(
    name: str, arguments: Any, message: str, model: Path
) -> None:
    named = {"class_path": f"kfit.generators.{name}", "init_args": arguments}
    put_card(model, changed(("networks", "generator"), named), MUG)
    assert message in refused(load, model)


def weights(header: dict[str, Any] | bytes, numbers: bytes = b"\0" * 16, length: int | None = None) -> bytes:
    content = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(content) if length is None else length) + content + numbers


HEADERS = {
    "cut short": b"\x01",
    "header beyond the file": weights({}, length=2**62),
    "no json": weights(b"{" * 1000),
    "offsets beyond the file": weights({"a": {"dtype": "F32", "shape": [100], "data_offsets": [0, 400]}}),
    "overlapping": weights({k: {"dtype": "F32", "shape": [4], "data_offsets": [0, 16]} for k in "ab"}),
    "product overflows": weights({"a": {"dtype": "F32", "shape": [2**33, 2**33], "data_offsets": [0, 16]}}),
    "kind unknown": weights({"a": {"dtype": "PICKLE", "shape": [4], "data_offsets": [0, 16]}}),
    "negative": weights({"a": {"dtype": "F32", "shape": [-4], "data_offsets": [0, 16]}}),
    "many": weights({str(k): {"dtype": "U8", "shape": [0], "data_offsets": [0, 0]} for k in range(10**4)}, b""),
    "not a number": weights(
        {"generator.constant": {"dtype": "F32", "shape": [4], "data_offsets": [0, 16]}}, b"\0\0\xc0\x7f" * 4
    ),
}


@pytest.mark.parametrize("kind", HEADERS)
def test_damaged_weights_get_a_sentence(kind: str, tmp_path: Path) -> None:
    (tmp_path / "m.json").write_text(json.dumps(CARD))
    (tmp_path / "m.safetensors").write_bytes(HEADERS[kind])
    message = refused(load, tmp_path / "m.safetensors")
    assert {"many": "does not fit its card", "not a number": "are not finite"}.get(kind, "damaged") in message


class _Asks:
    def __init__(self, call: Callable[..., Any], *args: Any) -> None:
        self.reduced = call, args

    def __reduce__(self) -> tuple[Any, ...]:
        return self.reduced


def checkpoint(path: Path, **changes: Any) -> None:
    content = {
        "hyper_parameters": CARD["networks"],
        "state_dict": {},
        "datamodule_hyper_parameters": {"category": "mug"},
    }
    torch.save(content | changes, path)


def test_a_checkpoint_stands_for_no_more_than_it_holds(tmp_path: Path) -> None:
    path, packed = tmp_path / "last.ckpt", tmp_path / "bomb.ckpt"
    checkpoint(path, state_dict={"generator.constant": torch.zeros(5_000_000)})
    with zipfile.ZipFile(path) as whole, zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as small:
        for part in whole.namelist():
            small.writestr(part, whole.read(part))
    assert packed.stat().st_size < 100_000
    assert "unpacks to 20,0" in refused(read_checkpoint, packed)
    checkpoint(path, state_dict={"generator.constant": torch.zeros(1).expand(LARGEST_WEIGHTS)})
    assert "stands for more than 4 GB" in refused(read_checkpoint, path)
    checkpoint(path, more=_Asks(set, _Asks(bytearray, 3 * 10**9)))  # looped for minutes
    assert "asks for a bytearray" in refused(read_checkpoint, path)
    path.write_bytes(pickle.dumps(_Asks(bytearray, 10**12), protocol=2))
    assert "asks for a bytearray" in refused(read_checkpoint, path)
    path.write_bytes(b"")
    assert "damaged" in refused(read_torch, path)


@pytest.mark.parametrize("name", ["hyper_parameters", "state_dict", "datamodule_hyper_parameters"])
def test_whatever_stands_in_a_checkpoint_gets_a_sentence(name: str, tmp_path: Path) -> None:
    nested: list[Any] = [1]
    for _ in range(40):  # 2⁴⁰ items, were they counted one by one
        nested = [nested, nested]
    for value in (None, [1], "x", {"generator": nested}, {"generator.constant": "x"}, {1: torch.zeros(1)}):
        checkpoint(tmp_path / "last.ckpt", **{name: value})
        refused(read_checkpoint, tmp_path / "last.ckpt")


def test_somebody_s_own_network_is_built_once_it_was_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "of_a_stranger.py").write_text("from kfit.generators import RadianceField as Mine\n")
    named = CARD["networks"]["generator"] | {"class_path": "of_a_stranger.Mine"}
    put_card(tmp_path / "m.safetensors", changed(("networks", "generator"), named), MUG)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "no network of kfit" in refused(load, tmp_path / "m.safetensors")
    __import__("of_a_stranger")
    assert load(tmp_path / "m.safetensors").card.category == "mug"

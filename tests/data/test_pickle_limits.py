"""Small pickles that stand for far more than they hold are refused at once, and in little memory."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from kfit.data import load_pickle
from kfit.data.pickle_limits import check_pickle

PAIRS = 60
TUPLES = b"\x80\x02K\x01" + b"q\x00h\x00\x86" * PAIRS
LISTS = b"\x80\x02]q\x00K\x01a" + b"".join(
    b"]q" + bytes([level]) + b"(h" + bytes([level - 1]) + b"h" + bytes([level - 1]) + b"e" for level in range(1, PAIRS)
)
BOMBS = {
    "shared tuples": TUPLES + b".",
    "shared tuples as a key": b"\x80\x02}" + TUPLES[2:] + b"K\x01s.",
    "shared tuples in a set": b"\x80\x04\x8f(" + TUPLES[2:] + b"\x90.",
    "shared tuples as text": b"cbuiltins\nstr\n" + TUPLES[2:] + b"\x85R.",
    "shared lists": LISTS + b".",
    "shared lists as text": b"cbuiltins\nstr\n" + LISTS[2:] + b"\x85R.",
    "deep tuples": b"\x80\x02)" + b"\x85" * 10**6 + b".",
    "deep lists": b"\x80\x02" + b"]" * 10**5 + b"a" * (10**5 - 1) + b".",
    "a list in itself": b"\x80\x02]q\x00h\x00a.",
    "bytes by their number": b"cbuiltins\nbytes\nI2147483647\n\x85R.",
    "bytearray by its number": b"c__builtin__\nbytearray\nI2147483647\n\x85R.",
    "memory for a memo": b"\x80\x02K\x01r\xff\xff\xff\x3f.",
    "memory for a memo, as text": b"K\x01p1073741824\n.",
    "a mark alone": b"\x80\x02e.",
    "more than there is": b"\x80\x02\x86.",
}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_bomb_gets_a_sentence(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "results.pkl"
    path.write_bytes(BOMBS[kind])
    with pytest.raises(ValueError, match=r"results\.pkl (is damaged or no pickle|asks for)"):
        load_pickle(path)


@pytest.mark.slow
def test_no_bomb_takes_more_than_a_little_memory(tmp_path: Path) -> None:
    for number, content in enumerate(BOMBS.values()):
        (tmp_path / f"{number}.pkl").write_bytes(content)
    program = """
import resource, sys
from pathlib import Path
from kfit.data import load_pickle
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in Path(sys.argv[1]).iterdir():
    try:
        load_pickle(path)
    except ValueError:
        continue
    raise SystemExit("read")
assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000
"""
    subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=True, timeout=300)


def test_what_is_shared_honestly_is_read(tmp_path: Path) -> None:
    size = (480, 640)
    value = {"sizes": [size] * 1000, "nested": [[[[1, 2]]]], size: "key"}
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        check_pickle(pickle.dumps(value, protocol))
        (tmp_path / "a.pkl").write_bytes(pickle.dumps(value, protocol))
        assert load_pickle(tmp_path / "a.pkl") == value

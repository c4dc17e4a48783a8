"""Pickles of plain values come back; everything else is refused before it is called."""

from __future__ import annotations

import os
import pickle
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from kfit.data import dump_pickle, load_pickle

PLAIN = {
    "image_path": "data/real/test/scene_1/0000",
    "gt_RTs": np.arange(32, dtype=np.float64).reshape(2, 4, 4),
    "columns": np.asfortranarray(np.arange(6, dtype=np.int32).reshape(2, 3)),
    "swapped": np.array([1.5, -2], ">f4"),
    "image_id": np.int64(7),
    "mask": np.array([[True, False]]),
    "names": np.array(["mug", "ü"]),
    "nothing": np.zeros((0, 4, 4)),
    "lists": [1, 2.5, (None, True), {"a"}, frozenset([3]), b"raw", bytearray(b"x")],
}


def same(a, b):
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and bool((a == b).all()) and type(b) is np.ndarray
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and all(map(same, a, b))
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_and_plain_values_come_back_from_every_protocol(tmp_path, protocol):
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(PLAIN, protocol))
    found = load_pickle(path)
    assert list(found) == list(PLAIN)
    for key, value in PLAIN.items():
        assert same(value, found[key]), key
    found["gt_RTs"][0] = 0  # not read-only


def test_written_pickles_are_read_by_anyone_and_name_no_module_of_numpy_2(tmp_path):
    dump_pickle(tmp_path / "a.pkl", PLAIN)
    raw = (tmp_path / "a.pkl").read_bytes()
    assert b"numpy._core" not in raw
    by_others = pickle.loads(raw)
    by_others["swapped"] = by_others["swapped"].astype(">f4")  # NumPy brings bytes into the machine's order
    for found in (by_others, load_pickle(tmp_path / "a.pkl")):
        assert all(same(value, found[key]) for key, value in PLAIN.items())
    assert [path.name for path in tmp_path.iterdir()] == ["a.pkl"]


def test_pickles_of_python_2_are_read(tmp_path):
    # pickle.dumps({"a": numpy.array([1.0, 2.0])}, 2) of Python 2.7 and NumPy 1.16
    raw = (
        b"\x80\x02}q\x01U\x01aq\x02cnumpy.core.multiarray\n_reconstruct\nq\x03cnumpy\nndarray\nq\x04K\x00\x85U\x01b\x87R"
        b"q\x05(K\x01K\x02\x85cnumpy\ndtype\nq\x06U\x02f8K\x00K\x01\x87Rq\x07(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff"
        b"\xff\xffK\x00tb\x89U\x10\x00\x00\x00\x00\x00\x00\xf0?\x00\x00\x00\x00\x00\x00\x00@tbs."
    )
    (tmp_path / "a.pkl").write_bytes(raw)
    np.testing.assert_array_equal(load_pickle(tmp_path / "a.pkl")["a"], [1, 2])


class Harm:
    """Makes a folder when unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)


def test_a_pickle_that_would_run_something_runs_nothing(tmp_path):
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"gt_RTs": [Harm(tmp_path / "made")]}))
    with pytest.raises(ValueError, match=r"asks for (posix|nt)\.mkdir, which is neither an array nor a plain value"):
        load_pickle(path)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("value", "asked"),
    [
        (OrderedDict(a=1), r"collections\.OrderedDict"),
        (np.array([None, {}]), "arrays of 'O8'"),
        (np.zeros(2, [("a", "f4")]), "arrays of 'V4'"),
        (Path("a"), "pathlib"),
        (np.float32, r"numpy\.float32"),
        (getattr, r"builtins\.getattr"),
        (eval, r"builtins\.eval"),
        (complex(1, 2), r"builtins\.complex"),
        (int, "a function"),
    ],
)
def test_other_kinds_are_refused_by_name(tmp_path, value, asked):
    (tmp_path / "a.pkl").write_bytes(pickle.dumps([value], protocol=3))
    with pytest.raises(ValueError, match=f"asks for {asked}.*neither an array nor a plain value"):
        load_pickle(tmp_path / "a.pkl")


def test_a_dtype_whose_state_speaks_of_pointers_is_refused(tmp_path):
    # dtype('f8') told to have fields, as no honest pickle does
    raw = b"\x80\x03cnumpy\ndtype\nX\x02\x00\x00\x00f8K\x00K\x01\x87R(K\x03X\x01\x00\x00\x00|N)}K\x08K\x08K\x3ftb."
    (tmp_path / "a.pkl").write_bytes(raw)
    with pytest.raises(ValueError, match="asks for a structured dtype"):
        load_pickle(tmp_path / "a.pkl")


@pytest.mark.parametrize("raw", [b"", b"no pickle", pickle.dumps(PLAIN, 3)[:-40], b"\x80\x03cnumpy\ndtype\n)R."])
def test_damaged_files_are_named(tmp_path, raw):
    (tmp_path / "a.pkl").write_bytes(raw)
    with pytest.raises(ValueError, match=r"a\.pkl is damaged or no pickle"):
        load_pickle(tmp_path / "a.pkl")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no file"):
        load_pickle(tmp_path / "none.pkl")


def test_the_excerpts_pickles_are_read(dev_data):
    files = sorted((dev_data / "nocs_sample/gts/val").glob("*.pkl"))
    for path in files:
        loaded = load_pickle(path)
        assert loaded["gt_RTs"].shape == (len(loaded["gt_class_ids"]), 4, 4)
        assert loaded["gt_scales"].dtype == np.float32

"""A bundled model answers the same, whatever is beside the photo and before it."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

import kfit
import kfit.fitting.prepared_terms
from kfit.core import FitResult, Observation

FIT = """
import sys, torch, numpy as np, kfit
torch.manual_seed(int(sys.argv[1])); torch.rand(int(sys.argv[1]))
mask = np.zeros((60, 80)); mask[10:50, 20:60] = 1
answer = kfit.load("mug").pose(np.random.default_rng(0).random((60, 80, 3)), mask=mask, seed=7)
print(answer.rotation.tobytes().hex(), answer.translation.tobytes().hex(), answer.energy, answer.confidence)
"""


@pytest.mark.slow
def test_two_processes_answer_the_same_to_the_last_bit_whatever_they_drew_before() -> None:
    answers = [
        subprocess.run([sys.executable, "-c", FIT, number], capture_output=True, text=True, check=True).stdout
        for number in ("1", "99")
    ]
    assert answers[0] == answers[1]
    assert len(answers[0]) > 100


@pytest.mark.slow
def test_a_bundled_model_s_answer_is_the_same_in_any_batch_and_chunk(monkeypatch) -> None:
    from kfit.bench.held_out_views import held_out_views

    model = kfit.load("mug")
    observed, fit = held_out_views(model, 3).observation, model.pipeline()

    def fitted(*rows: int) -> FitResult:
        fields = {name: getattr(observed, name)[list(rows)] for name in ("image", "mask", "intrinsics")}
        return fit(Observation(**fields, keys=rows), seed=3)

    whole = fitted(0, 1, 2)
    ends = [(fitted(1), [1]), (fitted(2, 0), [2, 0])]
    for pictures in (1, 1000):
        monkeypatch.setitem(kfit.fitting.prepared_terms.CHUNK_PIXELS, "cpu", pictures * 64 * 64)
        ends.append((fitted(0, 1, 2), [0, 1, 2]))
    for found, rows in ends:
        assert found.start.tolist() == whole.start[rows].tolist()
        for name, limit in (("azimuth", 4e-3), ("elevation", 4e-3), ("roll", 4e-3), ("shift", 4e-3), ("scale", 4e-3)):
            torch.testing.assert_close(found.values[name], whole.values[name][rows], rtol=0, atol=limit)
        torch.testing.assert_close(found.energy, whole.energy[rows], rtol=5e-3, atol=0)

from __future__ import annotations

import pytest
import torch

from kfit.generators import PoseHead


@pytest.mark.parametrize(("symmetry", "bins"), [("none", 36 * 9), ("y", 9)])
def test_gives_log_probabilities_over_upright_bins(symmetry, bins) -> None:
    head = PoseHead(symmetry)
    log_probability = head(torch.rand(2, 3, 64, 64))
    assert log_probability.shape == (2, bins)
    torch.testing.assert_close(log_probability.exp().sum(1), torch.ones(2))
    assert not head.predicts_roll


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"symmetry": "z"}, "PoseHead: symmetry must be one of none, y, y2"),
        ({"bin_deg": 0.5}, "PoseHead: bin_deg must lie between 1 and 90"),
        ({"sigma_deg": 0.0}, "PoseHead: sigma_deg must lie between"),
        ({"elevation_deg": (30.0, 20.0)}, "PoseHead: elevation_deg must rise within"),
    ],
)
def test_refuses_bins_that_are_none(settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        PoseHead(**settings)

"""Sizes are limited in files and nowhere else."""

import pytest

from kfit.generators import VAE2D, ConvEncoder, ExtentsHead
from kfit.pose.network_limits import check_drawing, check_network_sizes


def test_code_may_build_what_no_file_may_ask_for():
    assert ExtentsHead(code_dim=5000, hidden_dim=1).layers[0].in_features == 5000
    assert ConvEncoder(code_dim=5000, channels=[1, 1], hidden_dim=1, image_size=4) is not None
    with pytest.raises(ValueError, match="code_dim must be at most 4096 in a file, got 5000"):
        check_network_sizes({"code_dim": 5000})


def test_what_a_network_draws_is_limited_too():
    network = VAE2D(code_dim=1, decoder_dims=[1] * 10)
    assert network.image_size == 2048
    with pytest.raises(ValueError, match="image_size in a file must lie between 1 and 1024, got 2048"):
        check_drawing(network)

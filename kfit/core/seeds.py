"""Independent streams of random numbers."""

from __future__ import annotations


def mixed_seed(seed: int, key: int, stream: str) -> int:
    """Hash a seed, a problem's key and a stream's name to one number: FNV-1a over their bytes."""
    mixed = 0xCBF29CE484222325
    for byte in f"{seed}/{key}/{stream}".encode():
        mixed = ((mixed ^ byte) * 0x100000001B3) % 2**64
    return mixed % 2**63

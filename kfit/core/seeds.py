"""Streams of random numbers that do not depend on one another."""

from __future__ import annotations


def mixed_seed(seed: int, key: int, stream: str) -> int:
    """One number out of a seed, a problem's key and a stream's name: FNV-1a over their bytes, so it never varies."""
    mixed = 0xCBF29CE484222325
    for byte in f"{seed}/{key}/{stream}".encode():
        mixed = ((mixed ^ byte) * 0x100000001B3) % 2**64
    return mixed % 2**63

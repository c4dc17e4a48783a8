"""Benchmarks: accuracy, speed and scaling, each with its own command."""

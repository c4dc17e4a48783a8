"""Measure models on unseen objects, optimizers, registration, speed."""

from __future__ import annotations

from jsonargparse import ArgumentParser, Namespace

from kfit.bench import (
    accuracy,
    dataset,
    energies,
    minimum,
    optimizers,
    photos,
    registration,
    scaling,
    speed,
    tracking,
    training,
)
from kfit.bench.paper import command as paper

BENCHMARKS = {
    "accuracy": accuracy,
    "dataset": dataset,
    "energies": energies,
    "following": tracking,
    "minimum": minimum,
    "optimizers": optimizers,
    "photos": photos,
    "registration": registration,
    "paper": paper,
    "scaling": scaling,
    "speed": speed,
    "training": training,
}


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench``."""
    return ArgumentParser(
        description="Measure models, optimizers and image registration, and print tables. `kfit bench WHAT --help` "
        "shows the usage of a benchmark.",
        epilog="examples:\n  kfit bench accuracy --categories '[mug]' --views 20\n  kfit bench registration",
    )


def add_benchmarks(parser: ArgumentParser) -> None:
    """Add the benchmarks to the parser of ``kfit bench``, which must have its place in the tree by then."""
    commands = parser.add_subcommands(title="what to measure", description=None, metavar="WHAT")
    for name, benchmark in BENCHMARKS.items():
        commands.add_subcommand(name, benchmark.parser(), help=str(benchmark.__doc__).partition("\n")[0])


def run(args: Namespace) -> None:
    """Run the requested benchmark."""
    BENCHMARKS[args.subcommand].run(args[args.subcommand])

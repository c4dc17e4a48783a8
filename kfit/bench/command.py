"""Measure: models on objects that they have never seen, optimizers, and image registration."""

from __future__ import annotations

from jsonargparse import ArgumentParser, Namespace

from kfit.bench import accuracy as bench_accuracy
from kfit.bench import dataset as bench_dataset
from kfit.bench import energies as bench_energies
from kfit.bench import optimizers as bench_optimizers
from kfit.bench import registration as bench_registration
from kfit.bench import scaling as bench_scaling
from kfit.bench import speed as bench_speed
from kfit.bench import tracking as bench_following
from kfit.bench import training as bench_training
from kfit.bench.paper import command as bench_paper

BENCHMARKS = {
    "accuracy": bench_accuracy,
    "dataset": bench_dataset,
    "energies": bench_energies,
    "following": bench_following,
    "optimizers": bench_optimizers,
    "registration": bench_registration,
    "paper": bench_paper,
    "scaling": bench_scaling,
    "speed": bench_speed,
    "training": bench_training,
}


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench``."""
    return ArgumentParser(
        description="Measure models, optimizers and image registration, and print tables. `kfit bench WHAT --help` "
        "tells more of a benchmark.",
        epilog="examples:\n  kfit bench accuracy --categories '[mug]' --views 20\n  kfit bench registration",
    )


def add_benchmarks(parser: ArgumentParser) -> None:
    """Add the benchmarks to the parser of ``kfit bench``, which must have its place in the tree by then."""
    commands = parser.add_subcommands(title="what to measure", description=None, metavar="WHAT")
    for name, benchmark in BENCHMARKS.items():
        commands.add_subcommand(name, benchmark.parser(), help=str(benchmark.__doc__).partition("\n")[0])


def run(args: Namespace) -> None:
    """Run the benchmark that was asked for."""
    BENCHMARKS[args.subcommand].run(args[args.subcommand])

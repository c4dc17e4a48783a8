"""What all tests share: the slow ones wait for ``--runslow``, and some need the development data."""

import os
from pathlib import Path

import pytest
import torch

pytest_plugins = ["tiny_model"]

# Of several processes (``-n``) each has its share of the cores, and so have those that it starts.
if "PYTEST_XDIST_WORKER_COUNT" in os.environ:
    share = max(1, (os.cpu_count() or 1) // int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))
    os.environ["OMP_NUM_THREADS"] = str(share)
    torch.set_num_threads(share)


def pytest_addoption(parser):
    parser.addoption("--runslow", action="store_true", help="also run tests that take minutes")
    parser.addoption("--device", default="cpu", help="where parts are tested: cpu, cuda, cuda:1, mps")
    parser.addoption("--dtype", default="float32", choices=("float32", "float64"), help="in which numbers")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--runslow"):
        return
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.skip(reason="takes minutes: give --runslow"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    """Spell out what is no Unicode in the output of a test, which one of several processes could not send."""
    report = yield
    report.sections = [(name, text.encode(errors="backslashreplace").decode()) for name, text in report.sections]
    return report


@pytest.fixture(autouse=True)
def seeded():
    """The same random numbers for a test alone and among others."""
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def device(request):
    """Where energies, warps and generators are tested, by ``--device``."""
    return torch.device(request.config.getoption("--device"))


@pytest.fixture(scope="session")
def dtype(request):
    """In which numbers energies, warps and generators are tested, by ``--dtype``."""
    return getattr(torch, request.config.getoption("--dtype"))


@pytest.fixture(scope="session")
def dev_data():
    """Folder of the development data, which the repository does not hold."""
    if not os.environ.get("KFIT_DEV_DATA"):
        pytest.skip("KFIT_DEV_DATA names no folder of development data")
    return Path(os.environ["KFIT_DEV_DATA"])

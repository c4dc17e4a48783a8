"""The stages of `.ci/run`, and the workflow that runs each of them."""

import re
import subprocess
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
STAGES = re.search(r"^stages=\((.*)\)$", (ROOT / ".ci/run").read_text(), re.MULTILINE)[1].split()


def test_the_workflow_runs_every_stage():
    workflow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())
    assert workflow["jobs"]["run"]["strategy"]["matrix"]["stage"] == STAGES


def test_every_stage_is_defined_and_described():
    text = (ROOT / ".ci/run").read_text()
    for stage in STAGES:
        assert f"\n{stage}() {{\n" in text
        assert re.search(rf"^#   {stage} ", text, re.MULTILINE)


def test_an_unknown_stage_is_refused_by_name():
    done = subprocess.run([ROOT / ".ci/run", "lint", "nonsense"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"unknown stage nonsense; the stages are {' '.join(STAGES)}\n"

"""The page on dependencies lists what pyproject.toml installs, and every extra."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PAGE = (ROOT / "docs/dependencies.md").read_text()
ROW = re.compile(r"^\| `([\w-]+)` \| .+ \| .+ \| .+ \|$", re.MULTILINE)
# For who develops kfit, and not for who uses it.
OF_DEVELOPERS = {"docs", "test"}


def names(lines):
    return {Requirement(line).name for line in lines}


def test_every_package_that_is_installed_has_its_row_and_no_other():
    extras = {name: lines for name, lines in PROJECT["optional-dependencies"].items() if name not in OF_DEVELOPERS}
    wanted = names(PROJECT["dependencies"]) | set().union(*map(names, extras.values())) - {"kfit"}
    assert set(ROW.findall(PAGE)) == wanted
    assert all(f"`kfit[{extra}]`" in PAGE for extra in extras)


def test_all_holds_every_extra_that_a_user_may_want():
    (everything,) = map(Requirement, PROJECT["optional-dependencies"]["all"])
    assert everything.extras == set(PROJECT["optional-dependencies"]) - OF_DEVELOPERS - {"all"}

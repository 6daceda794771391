"""Shared fixtures: a kernel cache of the test run's own, shipped rigs, and the logs that another
simulator made.
"""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis
import pytest

from distal import Rig, load_rig
from distal.kernels import find_compiler

hypothesis.settings.register_profile("distal", deadline=None, derandomize=True, max_examples=60)
hypothesis.settings.load_profile("distal")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden files anew, to look at in a diff",
    )


os.environ["DISTAL_TRACEBACK"] = (
    "1"  # a fault of distal in a command is an error of the test, not a line
)


WISH = os.environ.get("DISTAL_COMPILE")
"""What whoever runs the tests said of compiling."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let the kernels of most fast tests be interpreted: the same numbers, without seconds of a
    compiler for each.

    A hook and not a fixture: it is in force before fixtures of any scope are made, and processes
    inherit it.
    """
    compiled = item.get_closest_marker("compiled") or item.get_closest_marker("slow")
    wish = WISH if compiled else "0"
    if os.environ.get("DISTAL_COMPILE") != wish:
        find_compiler.cache_clear()  # it remembers what it found
        if wish is None:
            del os.environ["DISTAL_COMPILE"]
        else:
            os.environ["DISTAL_COMPILE"] = wish


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    # workers of one test run share the folder, so each kernel is built once
    shared = tmp_path_factory.getbasetemp().parent / "kernels"
    os.environ["DISTAL_CACHE"] = str(shared)


@pytest.fixture(scope="session")
def paper_rig() -> Rig:
    return load_rig("paper-2008-printed")


@pytest.fixture(scope="session")
def pulley_rig() -> Rig:
    return load_rig("pulley-antagonist")


@pytest.fixture(scope="session")
def data() -> Path:
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        pytest.skip(
            "DISTAL_DATA is not set: the logs of another simulator are not part of the project"
        )
    return Path(folder)

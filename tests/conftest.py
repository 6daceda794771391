"""Shared fixtures: a kernel cache of the test run's own, shipped rigs, and the logs that another simulator made."""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis
import pytest

from distal import Rig, load_rig

hypothesis.settings.register_profile("distal", deadline=None, derandomize=True, max_examples=60)
hypothesis.settings.load_profile("distal")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="write the golden files anew, to look at in a diff")


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    # workers of one test run share the folder, so each kernel is built once
    shared = tmp_path_factory.getbasetemp().parent / "kernels"
    os.environ["DISTAL_CACHE"] = str(shared)


@pytest.fixture(scope="session")
def paper_rig() -> Rig:
    return load_rig("paper-2008")


@pytest.fixture(scope="session")
def pulley_rig() -> Rig:
    return load_rig("pulley-antagonist")


@pytest.fixture(scope="session")
def data() -> Path:
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        pytest.skip("DISTAL_DATA is not set: the logs of another simulator are not part of the project")
    return Path(folder)

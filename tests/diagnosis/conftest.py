"""The paper's rig, and a log of a plant that is as it says."""

from __future__ import annotations

import pytest

from distal import Log, Rig
from tests.support import cases


@pytest.fixture(scope="package")
def rig() -> Rig:
    return cases.paper_rig("as the rig")


@pytest.fixture(scope="package")
def log() -> Log:
    return cases.paper_log("servo", "as the rig", 0)

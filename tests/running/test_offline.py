"""The driver over a whole log: what it accepts."""

from __future__ import annotations

import pytest
from benchmarks.cases import paper_log, paper_rig

from distal import estimate
from distal.errors import EstimationError


def test_passes_are_for_the_papers_filters() -> None:
    with pytest.raises(EstimationError, match="one pass"):
        estimate(paper_log("servo", "as the rig", 0), paper_rig("as the rig"), "adaptive", passes=2)

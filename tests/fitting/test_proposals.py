"""What a rig may lack is tried on logs left out, and told where it helps."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.strangers.rough_plants import described, log_of

from distal import load_rig
from distal.fitting.leave_out import leave_out
from distal.fitting.options import Options
from distal.fitting.proposals import TRIED_LOGS, Change, Proposal, best, changes_of, propose
from distal.rig import build_rig


def test_what_a_rig_has_is_not_proposed() -> None:
    """A sheath is declared: its bend may differ from log to log; creep, and arms that change, are not."""
    sheath = build_rig(described("sheath", 0)[0], "sheath")
    made = {change.text: change for change in changes_of(sheath)}
    assert any(change.per_log == ("tendons.*.path.wrap",) for change in made.values())
    assert not any("path of the tendons" in text for text in made)
    for change in made.values():
        assert change.values or change.per_log
        sheath.with_values(change.values)  # each is a description that is accepted
    paper = load_rig("paper-2008-printed")
    assert not any("insertion.kind" in change.text for change in changes_of(paper))  # pinned there, not wound


def test_every_proposal_for_a_shipped_rig_is_accepted() -> None:
    for name in ("template", "capstan-joint", "lab-bench", "finger-2n", "wrist-instrument", "pulley-antagonist"):
        rig = load_rig(name).bare()
        for change in changes_of(rig):
            if change.values:
                assert rig.with_values(change.values) != rig


def test_a_sentence_tells_what_it_brings() -> None:
    said = Proposal(Change("creep of the tendons"), np.deg2rad(0.5), np.deg2rad(0.25)).text
    assert said == "creep of the tendons: tried, it takes the error on logs left out from 0.5° to 0.25°"


def test_the_best_three_that_gain_a_tenth_are_told() -> None:
    tried = [Proposal(Change(str(after)), 1.0, after) for after in (0.95, 0.7, np.inf, 0.89, 0.5, 0.8, 1.2)]
    assert [one.after for one in best(tried)] == [0.5, 0.7, 0.8]
    assert [one.after for one in best(tried[:1] + tried[3:4])] == [0.89]


@pytest.mark.slow
def test_a_bend_that_differs_from_log_to_log_is_proposed() -> None:
    """And creep, which these tendons do not have, is not."""
    rig = build_rig(described("sheath", 0)[0], "sheath").bare()
    logs = [log_of("sheath", 0, k) for k in range(4)]
    options, groups = Options(workers=2), [str(k) for k in range(4)]
    found = propose(logs, rig, options, groups, leave_out(logs, rig, options, groups, most=TRIED_LOGS))
    assert found
    assert found[0].change.per_log == ("tendons.*.path.wrap",)
    assert found[0].after < 0.95 * found[0].before
    assert all("creep" not in one.text for one in found)

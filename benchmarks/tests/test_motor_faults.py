"""Faults while a hand moves, on plants of others: the smallest case of the benchmark."""

from __future__ import annotations

import pytest

from benchmarks.motor_faults import drawn, judged, run


@pytest.mark.slow
def test_no_fault_moves_a_joint_that_nobody_asked_to_move() -> None:
    """Beyond its speed times 0.1 s, and what the twin overshoots; no motor pushes on for long."""
    seeds = range(40_000, 40_005)
    episodes = judged(run(seeds, drawn), seeds)
    assert len({one.kind for one in episodes}) > 3
    for one in episodes:
        assert one.unasked <= 2.0, one
        assert one.pushed <= 0.2, one
        if one.kind == "lost reads":
            assert one.away <= 0.5, one

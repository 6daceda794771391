"""The three sequences of docs/explanation/architecture.md are the order in which the calls come."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

from distal import Inverse, diagnose, estimate, fit, load_rig, simulate
from tests.helpers import turned_capstan

PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "architecture.md"
SEQUENCES = {
    name: calls.split(", ")
    for name, calls in (
        line.split(": ", 1)
        for line in PAGE.read_text(encoding="utf-8")
        .split("```text")[-1]
        .split("```")[0]
        .split("\n")
        if line
    )
}


def first_calls(run: Callable[[], object]) -> list[str]:
    """Return the functions of the package that a run calls, in the order of their first calls."""
    calls = dict[str, None]()

    def called(frame: FrameType, event: str, _: object) -> None:
        file = frame.f_code.co_filename
        if event == "call" and "/distal/" in file:
            module = file.split("/distal/")[-1].removesuffix(".py")
            calls.setdefault(f"{module}.{frame.f_code.co_name}")

    before = sys.getprofile()
    sys.setprofile(called)
    try:
        run()
    finally:
        sys.setprofile(before)
    return list(calls)


def runs() -> dict[str, Callable[[], object]]:
    rig = load_rig("capstan-joint")
    time = np.arange(0.0, 2.0, 0.01)
    logs = [simulate(rig, turned_capstan(12.0), seed) for seed in (1, 2, 3)]
    return {
        "estimate": lambda: diagnose(estimate(logs[0], rig), logs[0], rig),
        "fit": lambda: fit(logs, rig),
        "command": lambda: Inverse(rig)(time, 0.3 * np.sin(time)),
    }


@pytest.mark.parametrize("name", list(SEQUENCES))
def test_the_calls_come_in_this_order(name: str) -> None:
    calls = first_calls(runs()[name])
    assert [call for call in calls if call in SEQUENCES[name]] == SEQUENCES[name]

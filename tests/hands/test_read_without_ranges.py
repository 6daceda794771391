"""The log of a power-on routine is read before anybody knows the motors' zeros."""

from __future__ import annotations

import sys

import pytest

from distal import load_rig
from distal.errors import LogError
from distal.hands import calibrate


def test_no_range_says_in_which_turn_a_motor_is(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = dict[str, object]()

    def read(log: object, rig: object, **ways: object) -> None:
        asked.update(ways)
        raise LogError("only what is asked for is looked at")

    monkeypatch.setattr(sys.modules["distal.hands.calibrate"], "read_log", read)
    with pytest.raises(LogError, match="only what is asked for"):
        calibrate("power_on.csv", load_rig("hand"))
    assert asked == {"ranged": False}

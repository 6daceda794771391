"""Calibration logs in which drives are held are logs like others; a sensor that is dead is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.strangers.rough_plants import described, log_of

from distal import Log, Rig
from distal.errors import FitError
from distal.fitting.checks import check_logs
from distal.rig import build_rig


def held(log: Log, *names: str) -> Log:
    """Return a log in which some sensors do not change at all."""
    still = {name: np.full(len(log), log.channels[name][0]) for name in names}
    return replace(log, channels={**log.channels, **still})


@pytest.fixture(scope="module")
def rig() -> Rig:
    return build_rig(described("held", 0)[0], "wrist")


def test_a_drive_that_is_held_in_one_log_and_moves_in_another(rig: Rig) -> None:
    one, whole = log_of("held", 0, 0), log_of("held", 0, 3)
    check_logs([held(one, "phi1", "tau1"), whole], rig)
    check_logs([held(one, "phi1"), whole], rig)  # its motor still holds against the others


@pytest.mark.parametrize("dead", [("tau0",), ("phi1",)])
def test_a_sensor_that_never_changes(rig: Rig, dead: tuple[str, ...]) -> None:
    """In no log, or, of a force, while its drive moves."""
    one, whole = log_of("held", 0, 0), log_of("held", 0, 3)
    with pytest.raises(FitError, match=f"sensor '{dead[0]}' is constant .* is it connected"):
        check_logs([held(one, *dead), held(whole, *dead) if dead == ("phi1",) else whole], rig)

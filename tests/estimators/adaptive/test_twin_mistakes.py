"""What the twin's tests must see: each mistake, made in the twin, is a difference a thousand times
the tolerance.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from distal.estimators import Robustness
from tests.estimators.adaptive import rigs, twin, twin_model, twin_states, twin_update
from tests.estimators.adaptive.agreement import TOLERANCE, course_of, difference, filtered
from tests.estimators.adaptive.test_twin import (
    DECLARED,
    DEFAULT,
    ERROR,
    GUARDS,
    NONE,
    PLAY,
    TEXTBOOK,
    TORQUE_BIAS,
    UNDECLARED,
    log_of,
    spoiled_log,
)
from tests.estimators.adaptive.twin import Twin

SEEN = 1e3 * TOLERANCE
PATH, BIASES = TEXTBOOK["path"][0], TEXTBOOK["biases with a reference"][0]
BIASED_PLAY = rigs.capstan(rigs.HYSTERESIS, ERROR, TORQUE_BIAS)
STOPS = TEXTBOOK["near stops"][0]
TORQUE, LINEARITY = TEXTBOOK["external torque"][0], TEXTBOOK["linearity"][0]
JOINT_STOPS = TEXTBOOK["stops of the joint"][0]
HARD_JUMP = replace(NONE, **GUARDS["a real jump"][1])

MISTAKES: dict[str, tuple[Any, str, str, str, Any, Robustness, float]] = {
    # mistake: where, what, right, wrong, rig, guards, size of wild values (0 for a clean log)
    "sign of the asymmetry": (
        twin_update,
        "friction_of",
        "- abs(way) * asym",
        "+ abs(way) * asym",
        PATH,
        NONE,
        0,
    ),
    "slope of the asymmetry": (
        twin_update,
        "update",
        "+ gamma * row.a_x",
        "- gamma * row.a_x",
        PATH,
        NONE,
        0,
    ),
    "asymmetry of a stuck drive": (
        twin_update,
        "clipped",
        "limit + asym",
        "limit - asym",
        PATH,
        NONE,
        0,
    ),
    "gain 5 % too small": (
        twin_update,
        "update",
        "gain = across / s_wild",
        "gain = 0.95 * across / s_wild",
        PATH,
        NONE,
        0,
    ),
    "weight of a wild force": (
        twin_update,
        "update",
        "s_wild * np.outer",
        "s * np.outer",
        UNDECLARED,
        DEFAULT,
        2.0,
    ),
    "the low stop": (
        twin_update,
        "near_stop",
        "not low + wrong < s < high",
        "not s < high",
        STOPS,
        NONE,
        0,
    ),
    "the high stop": (twin_update, "near_stop", "< s < high - wrong", "< s", STOPS, NONE, 0),
    "margin at the stops": (twin_update, "near_stop", "sensor.linearity + 2", "2", STOPS, NONE, 0),
    "depth in the high stop": (
        twin_update,
        "update",
        "twin.m[j] - high",
        "high - twin.m[j]",
        JOINT_STOPS,
        NONE,
        0,
    ),
    "depth in the low stop": (
        twin_update,
        "update",
        "low - twin.m[j]",
        "-1.0",
        JOINT_STOPS,
        NONE,
        0,
    ),
    "bias of a force": (
        twin_update,
        "force_row",
        "- added - offset",
        "- added + offset",
        BIASES,
        NONE,
        0,
    ),
    "slope of a force's bias": (
        twin_update,
        "force_row",
        "- added_x - bias_x",
        "- added_x + bias_x",
        BIASES,
        NONE,
        0,
    ),
    "offset of a tension": (
        twin_update,
        "rows_of",
        "reading - value - offset",
        "reading - value + offset",
        BIASES,
        NONE,
        0,
    ),
    "bias of a play": (twin.Twin, "play", "effort - bias", "effort + bias", BIASED_PLAY, NONE, 0),
    "slope of a play's bias": (
        twin.Twin,
        "play",
        "g[b] -= low + high",
        "g[b] += low + high",
        BIASED_PLAY,
        NONE,
        0,
    ),
    "sign of the transmission error": (
        twin_update,
        "force_row",
        "= (-m[error], -1.0)",
        "= (m[error], 1.0)",
        PLAY,
        NONE,
        0,
    ),
    "gain of considered states": (twin_update, "update", "gain[i] = 0.0", "pass", PLAY, NONE, 0),
    "variance of a lost place": (
        twin.Twin,
        "track",
        "d.square * tau ** 2 + noise",
        "noise",
        UNDECLARED,
        NONE,
        0.3,
    ),
    "joint of a lost drive": (
        twin.Twin,
        "followed",
        "max(tracked[i].grown, 0.0)",
        "0.0",
        UNDECLARED,
        NONE,
        0.3,
    ),
    "memory of residuals": (twin_update, "update", "row.r_x @ gain * nu", "0.0", DECLARED, NONE, 0),
    "fading of the mean residual": (
        twin_update,
        "friction_of",
        "f * d.residual",
        "d.residual",
        DECLARED,
        NONE,
        0,
    ),
    "fading of the torque": (twin.Twin, "revert", "factor[i, i] = f", "pass", TORQUE, NONE, 0),
    "noise of the torque": (twin.Twin, "revert", "(1 - f ** 2)", "(1 - f)", TORQUE, NONE, 0),
    "what friction hides of a torque": (
        twin.Twin,
        "predict",
        "rho = rho + rest",
        "pass",
        TORQUE,
        NONE,
        0,
    ),
    "linearity in the place": (
        twin.Twin,
        "positions_over",
        "- error, -slope",
        "- error, slope",
        LINEARITY,
        NONE,
        0,
    ),
    "doubt of a wild reading": (
        twin.Twin,
        "track",
        "+ a * (rate ** 2 - d.square)",
        "",
        UNDECLARED,
        DEFAULT,
        2.0,
    ),
    "a jump that stays": (
        twin.Twin,
        "track",
        "1 - doubt / lasting",
        "1 + doubt / lasting",
        UNDECLARED,
        HARD_JUMP,
        2.0,
    ),
    "a jump that its force denies": (
        twin.Twin,
        "evidence",
        "expected / 2",
        "expected / 3",
        UNDECLARED,
        HARD_JUMP,
        2.0,
    ),
    "both positions of a drive": (
        twin.Twin,
        "track",
        "s += p * o",
        "s -= p * o",
        UNDECLARED,
        HARD_JUMP,
        2.0,
    ),
    "the spread of both": (
        twin.Twin,
        "track",
        "(1 - p) * p * o ** 2",
        "(1 + p) * p * o ** 2",
        UNDECLARED,
        DEFAULT,
        2.0,
    ),
    "cut of a prior": (
        twin_states,
        "cut_at_zero",
        "if mean > 4 * std",
        "if True",
        DECLARED,
        NONE,
        0,
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_seen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    owner, function, right, wrong, rig, guards, size = MISTAKES[name]
    _make(monkeypatch, owner, function, right, wrong)
    log = spoiled_log(rig, size) if size else log_of(rig)
    _, course = filtered(rig, log, guards)
    mistaken = course_of(Twin(rig, guards, rig.sensors_of("angle")), log)
    assert difference(mistaken, course) > SEEN


def test_fading_in_the_transition_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    log = log_of(TORQUE)
    right = Twin(TORQUE, NONE)
    right.run(*log)
    _make(monkeypatch, twin.Twin, "revert", "transition[i] = f * transition[i]", "pass")
    wrong = Twin(TORQUE, NONE)
    wrong.run(*log)
    k = wrong.at("torque", 0)
    assert wrong.parts[5].transition[k, k] == 1.0
    assert right.parts[5].transition[k, k] == pytest.approx(
        np.exp(-(log[0][5] - log[0][4]) / 0.3), rel=1e-12
    )


def _make(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, right: str, wrong: str) -> None:
    """Put a mistake into a function of the twin."""
    # written anew, so that a mistake is one line however the twin's lines are broken
    source = ast.unparse(ast.parse(textwrap.dedent(inspect.getsource(getattr(owner, name)))))
    assert source.count(right) == 1, f"{name} has {source.count(right)} times '{right}'"
    module = owner if inspect.ismodule(owner) else sys.modules[owner.__module__]
    scope: dict[str, Any] = {}
    exec(
        compile(source.replace(right, wrong), f"<{name} with a mistake>", "exec"),
        vars(module),
        scope,
    )
    monkeypatch.setattr(owner, name, scope[name])
    # modules that took it by name
    for other in (twin, twin_model, twin_states, twin_update):
        if other is not owner and not inspect.isclass(owner) and hasattr(other, name):
            monkeypatch.setattr(other, name, scope[name])

"""Of a rig whose logs taught what forces are normal, the reading that is wrong is named, and none
on good logs or where something touches a joint.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig, diagnose, estimate
from distal.fitting.learned_maps import efforts_of
from tests.helpers import changed
from tests.support.pushed_finger import finger, finger_rig


@pytest.fixture(scope="module")
def rig() -> Rig:
    bare = finger_rig().bare()
    logs = [finger(seed, 12.0, None)[0] for seed in range(3)]
    return bare.with_map(efforts=efforts_of(logs, bare, range(3)))


@pytest.fixture(scope="module")
def log() -> Log:
    return replace(finger(9, 12.0, None)[0], truth={})


def first(log: Log, rig: Rig) -> tuple[str, str]:
    """Return subject and text of the first cause."""
    findings = diagnose(estimate(log, rig), log, rig).findings
    looks = [finding for finding in findings if finding.kind == "looks like"]
    return (looks[0].subject, looks[0].text) if looks else ("", "")


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("swap", "look swapped"),
        ("unit", "look 1000 times too small"),
        ("zero", "off: its zero"),
        ("scale", "times too large: gear"),
        ("sign", "as if its sign"),
    ],
)
def test_a_wrong_reading_is_named(kind: str, said: str, log: Log, rig: Rig) -> None:
    flexor, extensor = log.channels["x_flexor"], log.channels["x_extensor"]
    spoilt = {
        "zero": {"x_flexor": flexor + 4e-3},
        "scale": {"x_flexor": 2.0 * flexor},
        "sign": {"x_flexor": -flexor},
        "swap": {"x_flexor": extensor, "x_extensor": flexor},
        "unit": {name: log.channels[name] / 1000 for name in ("u_flexor", "u_extensor")},
    }
    subject, text = first(changed(log, **spoilt[kind]), rig)
    assert said in text
    assert set(subject.replace(" and ", ", ").split(", ")) == set(spoilt[kind])


def test_with_a_known_angle_the_size_is_that_of_the_error(rig: Rig) -> None:
    """Forces alone tell the least change after which they are normal."""
    good = finger(9, 12.0, None)[0]
    _, text = first(changed(good, x_flexor=2.0 * good.channels["x_flexor"]), rig)
    assert float(text.split(" looks ")[1].split()[0]) == pytest.approx(2.0, abs=0.05)


def test_nothing_is_named_without_a_reason(log: Log, rig: Rig) -> None:
    assert first(log, rig) == ("", "")
    pushed = replace(finger(7, 10.0, 6.0)[0], truth={})
    assert first(pushed, rig) == ("", "")


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_reading_that_says_nothing_ends_no_diagnosis(value: float, log: Log, rig: Rig) -> None:
    column = np.full(len(log), value)
    column[:2] = log.channels["x_flexor"][:2] * np.isnan(value)
    odd = changed(log, x_flexor=column, x_extensor=log.channels["x_extensor"] + 1e-2)
    for read in (odd, odd.select(slice(3))):
        diagnose(estimate(read, rig), read, rig)

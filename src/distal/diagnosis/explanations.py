"""Signs, units and gears that would explain a disagreement of a log with its rig, tried one at a
time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from distal.diagnosis import finding_texts as texts
from distal.diagnosis.finding import Finding
from distal.diagnosis.rerun import ModelChange, Outcome, Rerun
from distal.diagnosis.what_if import contradictions
from distal.rig import REFERENCES

UNIT_FACTORS: dict[float, dict[str, str]] = {
    -1.0: {"": "as if its sign were wrong"},
    1 / 57.295779513: {"rad": "like degrees"},
    57.295779513: {"rad": "57.3 times too small (converted from degrees twice?)"},
    1e-3: {
        "m": "like millimetres",
        "N": "like millinewtons",
        "N m": "like N mm",
        "": "1000 times too large",
    },
    1e3: {"": "1000 times too small"},
    4.4482216: {"N": "like pounds"},
    1 / 4.4482216: {"N": "4.45 times too large (pounds converted twice?)"},
}
"""Factor on a channel → SI unit of the sensor, or "" for any → what the channel looks like if that
factor makes it agree. Source: definition (conversion of units).
"""

GEARS = tuple(float(n) for n in np.geomspace(2.0, 200.0, 14))
"""Ratios of a gear that are tried, as are their inverses [1]. Source: judgement."""

GAIN = 0.5
"""Least gain in ln p per compared value of a change that explains something [1]. Source: judgement.
"""

LARGE = 2.5
"""Gain in ln p per compared value from which on a sign explains something even if some
contradictions remain [1]. Source: judgement.
"""

LOSS = -1.0
"""Least gain in ln p per compared value of a sign that leaves no contradiction [1]; it may be a
loss, since less is compared where drives stick. Source: judgement.
"""

LEAST_TURN = float(np.deg2rad(3.0))
"""Least turn of a joint after a change that explains something [rad]: a joint that stands still
agrees with most forces. Source: judgement.
"""

ALIKE = 0.05
"""Difference of gains below which two changes are equally likely, such as two signs [1]. Source:
judgement.
"""


def explanations(rerun: Rerun) -> list[Finding]:
    """Return the change of a sign, a unit or a gear that makes the log agree with the rig, if there
    is one.

    If a change of another sensor does so as well, both are named. A sign that leaves no
    contradiction comes before a unit: readings that a unit makes small agree with much.
    """
    base = _likelihood(rerun.base)
    before = len(contradictions(rerun, rerun.base))
    explain: list[tuple[bool, float, Finding]] = []
    tried = [*_signs_and_units(rerun), *_gears(rerun)]
    for (finding, change), outcome in zip(tried, rerun.each(change for _, change in tried)):
        gain = _likelihood(outcome) - base
        is_sign = set(change.channels.values()) == {-1.0}
        near = max((earlier for _, earlier, _ in explain), default=GAIN) - ALIKE
        if (
            not outcome.bounded
            or gain <= (LOSS if is_sign else max(GAIN, near))
            or not _moves(rerun, outcome)
        ):
            continue
        against = len(contradictions(rerun, outcome))
        if (against == 0 and (gain > 0.0 or before > 0)) or (
            is_sign and gain > LARGE and against < before
        ):
            explain.append((is_sign, gain, finding))
    if not explain:
        return []
    explain.sort(key=lambda explanation: (not explanation[0], -explanation[1]))
    likeliest = max(gain for _, gain, _ in explain)
    alike = {
        finding.subject: finding.text
        for is_sign, gain, finding in explain
        if is_sign or gain > likeliest - ALIKE
    }
    return [Finding("looks like", explain[0][2].subject, ", or ".join(list(alike.values())[:2]))]


def _signs_and_units(rerun: Rerun) -> Iterator[tuple[Finding, ModelChange]]:
    for sensor in rerun.estimator.rig.sensors:
        if sensor.name in rerun.estimator.channels and sensor.measures not in REFERENCES:
            for factor, words in UNIT_FACTORS.items():
                like = words.get(sensor.si, words.get(""))
                if like is not None:
                    yield (
                        texts.looks(sensor.name, like),
                        ModelChange(channels={sensor.name: factor}),
                    )


def _gears(rerun: Rerun) -> Iterator[tuple[Finding, ModelChange]]:
    """Yield for each capstan the ratio of a gear that fits best, on its angle and its torque."""
    rig = rerun.estimator.rig
    channels = rerun.estimator.channels
    for drive in rig.drives:
        sensors: dict[str, str] = {
            sensor.measures: sensor.name for sensor in rig.sensors if sensor.of == drive.name
        }
        kinds = {"position": -1, "force": 1}
        powers = {
            sensors[kind]: power for kind, power in kinds.items() if sensors.get(kind) in channels
        }
        if drive.kind == "capstan" and sensors.get("position") in channels:
            ratio = _best_ratio(rerun, powers)
            yield (
                texts.looks(drive.name, texts.like_a_gear(ratio)),
                _geared(powers, ratio),
            )


def _geared(powers: dict[str, int], ratio: float) -> ModelChange:
    return ModelChange(channels={name: ratio**power for name, power in powers.items()})


def _best_ratio(rerun: Rerun, powers: dict[str, int]) -> float:
    """Return the ratio with the largest likelihood among `GEARS` and their inverses, refined
    between its neighbours.
    """

    def best_of(ratios: Iterable[float]) -> float:
        tried = [float(ratio) for ratio in ratios]
        found = [
            _likelihood(outcome)
            for outcome in rerun.each(_geared(powers, ratio) for ratio in tried)
        ]
        return tried[int(np.argmax(found))]

    best = best_of((*GEARS, *(1 / gear for gear in GEARS)))
    for width in np.geomspace(GEARS[1] / GEARS[0], 1.01, 5):
        best = best_of(best * np.geomspace(1 / width, width, 5))
    return best


def _likelihood(outcome: Outcome) -> float:
    """Return ln p per compared value."""
    count = int(np.isfinite(outcome.innovations).sum())
    return outcome.log_likelihood / count if outcome.bounded and count else -np.inf


def _moves(rerun: Rerun, outcome: Outcome) -> bool:
    """Return whether any joint turns: a change after which none does agrees with everything."""
    return (
        float(np.ptp(outcome.means[:, : len(rerun.estimator.rig.joints)], axis=0).max())
        > LEAST_TURN
    )

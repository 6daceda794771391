"""The paper's statements C1 to C12 as measures on simulated runs, against thresholds written down beforehand."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.analysis.reproduction import PLANTS, Run
from distal.rig import tendon_angle_name

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Measure:
    """One number of a statement, its bounds, and its value on each plant.

    Args:
        text: what is measured.
        least: the smallest value that counts as holding, or None.
        most: the largest, or None.
        values: by plant.
    """

    text: str
    least: float | None
    most: float | None
    values: dict[str, float]

    def holds(self, plant: str) -> bool:
        """Return whether the value on a plant is within the bounds."""
        value = self.values[plant]
        above = self.least is None or value >= self.least
        return bool(np.isfinite(value) and above and (self.most is None or value <= self.most))


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, measured.

    Args:
        key: ``C1`` to ``C12``.
        statement: in words.
        why: of the threshold.
        measures: the main one first.
    """

    key: str
    statement: str
    why: str
    measures: tuple[Measure, ...]

    def holds(self, plant: str) -> bool:
        """Return whether all measures hold on a plant."""
        return all(measure.holds(plant) for measure in self.measures)

    @property
    def verdict(self) -> str:
        """Holds, does not hold, or holds only for one of the plants."""
        printed, observed = (self.holds(plant) for plant in PLANTS)
        if printed and observed:
            return "holds"
        if observed:
            return "holds only for the observed plant"
        return "holds only for the printed plant" if printed else "does not hold"


def measure_claims(runs: Sequence[Run]) -> tuple[Claim, ...]:
    """Return the paper's statements, measured on all runs.

    Args:
        runs: of `all_runs`.
    """
    text = resources.files("distal.analysis").joinpath("claims.toml").read_text(encoding="utf-8")
    claims = []
    for key, raw in tomllib.loads(text).items():
        specs = [raw, *raw.get("also", [])]
        values = {plant: _MEASURES[key]([run for run in runs if run.plant == plant]) for plant in PLANTS}
        measures = tuple(
            Measure(spec["measure"], spec.get("least"), spec.get("most"), {p: float(values[p][i]) for p in PLANTS})
            for i, spec in enumerate(specs)
        )
        claims.append(Claim(key, raw["statement"], raw["why"], measures))
    return tuple(claims)


def _pooled(errors: Sequence[Floats]) -> float:
    """Return the RMS over all samples of several errors [rad], in degrees."""
    return float(np.rad2deg(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))))


def rms(runs: Sequence[Run], series: str, estimator: str) -> float:
    """Return the RMS error of an estimator, pooled over the seeds of a series [°].

    Args:
        runs: of one plant.
        series: name of the scenario.
        estimator: key of `Run.estimates`.
    """
    return _pooled([run.estimates[estimator].errors() for run in runs if run.series == series])


def potentiometer_errors(run: Run) -> tuple[Floats, Floats]:
    """Return the errors of the left and right potentiometer's angle, tendons taken as inextensible [rad]."""
    result = run.estimates["inextensible"]
    left, right = (result.state(tendon_angle_name(side)) - run.log.truth["theta"] for side in ("left", "right"))
    return left, right


def _each_potentiometer(runs: Sequence[Run], series: str) -> tuple[float, float]:
    errors = [potentiometer_errors(run) for run in runs if run.series == series]
    return _pooled([left for left, _ in errors]), _pooled([right for _, right in errors])


def _c1(runs: Sequence[Run]) -> tuple[float, ...]:
    return (min(_each_potentiometer(runs, "series-1-soft")),)


def _c2(runs: Sequence[Run]) -> tuple[float, ...]:
    opposing, assisting = [], []
    for run in runs:
        if run.series != "series-1-soft":
            continue
        left, right = potentiometer_errors(run)
        speed = np.gradient(run.log.truth["theta"], run.log.time)
        down, up = speed < np.deg2rad(-2.0), speed > np.deg2rad(2.0)
        # the left tendon pulls to +θ: it opposes a falling angle
        opposing += [left[down], right[up]]
        assisting += [right[down], left[up]]
    return (_pooled(opposing) / _pooled(assisting),)


def _c3(runs: Sequence[Run]) -> tuple[float, ...]:
    soft, stiff = (float(np.mean(_each_potentiometer(runs, series))) for series in ("series-1-soft", "series-1"))
    pairs = zip(*([run for run in runs if run.series == series] for series in ("series-1-soft", "series-1")))
    alike = [
        np.corrcoef(a.estimates["inextensible"].means[:, i], b.estimates["inextensible"].means[:, i])[0, 1]
        for a, b in pairs
        for i in (1, 2)
    ]
    return stiff / soft, stiff, float(np.mean(alike))


def _c4(runs: Sequence[Run]) -> tuple[float, ...]:
    motions = []
    for run in runs:
        if run.series == "series-1-soft":
            for drive in ("left", "right"):
                motions.append(hidden_motion(run.log.truth["theta"], run.log.truth[f"position_{drive}"]))
    return (float(np.rad2deg(max(motions))),)


def hidden_motion(theta: Floats, position: Floats, within: float = 1e-4) -> float:
    """Return the largest change of θ [rad] over any stretch of time in which the slider stays within `within` [m].

    Args:
        theta: joint angle, (n,).
        position: of the slider [m], (n,).
        within: how far it may move.
    """
    largest, start = 0.0, 0
    for end in range(len(theta)):
        while np.ptp(position[start : end + 1]) > within:
            start += 1
        largest = max(largest, float(np.ptp(theta[start : end + 1])))
    return largest


def _c5(runs: Sequence[Run]) -> tuple[float, ...]:
    return (rms(runs, "series-2", "ekf-2008") / rms(runs, "series-2", "inextensible"),)


def _c6(runs: Sequence[Run]) -> tuple[float, ...]:
    return (rms(runs, "series-2-high", "inextensible") / rms(runs, "series-2", "inextensible"),)


def _c7(runs: Sequence[Run]) -> tuple[float, ...]:
    return (rms(runs, "series-2-high", "ekf-2008") / rms(runs, "series-2-high", "inextensible"),)


def _c8(runs: Sequence[Run]) -> tuple[float, ...]:
    beyond = {}
    for series in ("series-2", "series-2-high"):
        ends = [run.estimates["simulation"].errors()[-50:].mean() for run in runs if run.series == series]
        beyond[series] = float(np.rad2deg(np.mean(ends)))
    low = beyond["series-2"]
    growth = beyond["series-2-high"] / low if low > 0.0 else np.nan
    return beyond["series-2-high"], rms(runs, "series-2", "simulation"), growth


def _c9(runs: Sequence[Run]) -> tuple[float, ...]:
    changes = []
    for run in runs:
        if run.series == "series-1":
            with_it, without = run.estimates["inextensible"], run.estimates["without linearity"]
            changes += [with_it.means[:, i] - without.means[:, i] for i in (1, 2)]
    return (_pooled(changes),)


def _c10(runs: Sequence[Run]) -> tuple[float, ...]:
    return (rms(runs, "series-2", "ekf-2008") / rms(runs, "series-2", "hung weights"),)


def _c11(runs: Sequence[Run]) -> tuple[float, ...]:
    return (rms(runs, "series-2", "better cells") / rms(runs, "series-2", "ekf-2008"),)


def _c12(runs: Sequence[Run]) -> tuple[float, ...]:
    return (rms(runs, "series-2", "observed friction") / rms(runs, "series-2", "ekf-2008"),)


_MEASURES: dict[str, Callable[[Sequence[Run]], tuple[Any, ...]]] = {
    "C1": _c1,
    "C2": _c2,
    "C3": _c3,
    "C4": _c4,
    "C5": _c5,
    "C6": _c6,
    "C7": _c7,
    "C8": _c8,
    "C9": _c9,
    "C10": _c10,
    "C11": _c11,
    "C12": _c12,
}

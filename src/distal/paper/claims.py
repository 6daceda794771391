"""The paper's statements C1 to C12 as measures on simulated runs, against thresholds written down beforehand."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np

from distal.arrays import Floats
from distal.paper.series import PLANTS, Run
from distal.rig import tendon_angle_name


@dataclass(frozen=True)
class Measure:
    """One number of a statement and its bounds.

    Args:
        text: what is measured.
        least: the smallest value that counts as holding, or None.
        most: the largest, or None.
    """

    text: str
    least: float | None
    most: float | None

    def margin(self, value: float) -> float:
        """Return how far a value is within its bound, as a share of the bound; negative outside, −∞ without a value.

        Args:
            value: of the measure.
        """
        if not np.isfinite(value):
            return -np.inf
        below = np.inf if self.least is None else (value - self.least) / abs(self.least)
        return float(min(below, np.inf if self.most is None else (self.most - value) / abs(self.most)))


@dataclass(frozen=True)
class Statement:
    """A statement of the paper.

    Args:
        key: ``C1`` to ``C12``.
        text: in words.
        why: of the threshold.
        measures: the main one first; all must be within their bounds.
    """

    key: str
    text: str
    why: str
    measures: tuple[Measure, ...]

    def margin(self, values: Sequence[float]) -> float:
        """Return the smallest margin of its measures: the statement holds where it is not negative.

        Args:
            values: of the measures.
        """
        return min(measure.margin(value) for measure, value in zip(self.measures, values))


@lru_cache(maxsize=1)
def statements() -> tuple[Statement, ...]:
    """Return the paper's statements with the thresholds of `claims.toml`."""
    text = resources.files("distal.paper").joinpath("claims.toml").read_text(encoding="utf-8")
    return tuple(
        Statement(
            key,
            raw["statement"],
            raw["why"],
            tuple(
                Measure(each["measure"], each.get("least"), each.get("most")) for each in [raw, *raw.get("also", [])]
            ),
        )
        for key, raw in tomllib.loads(text).items()
    )


def measured(runs: Sequence[Run]) -> dict[str, tuple[float, ...]]:
    """Return the values of all measures, by statement.

    Args:
        runs: of one plant: every series that a statement needs.
    """
    return {key: tuple(float(value) for value in measure(runs)) for key, measure in _MEASURES.items()}


@dataclass(frozen=True)
class Claim:
    """A statement, measured on the plants of the reproduction.

    Args:
        statement: what the paper says.
        values: of its measures, by plant.
    """

    statement: Statement
    values: Mapping[str, tuple[float, ...]]

    def holds(self, plant: str) -> bool:
        """Return whether all measures are within their bounds on a plant."""
        return self.statement.margin(self.values[plant]) >= 0.0

    @property
    def group(self) -> str:
        """Return one of `GROUPS`."""
        printed, observed = (self.holds(plant.name) for plant in PLANTS)
        return GROUPS[2] if not observed else GROUPS[0] if printed else GROUPS[1]


GROUPS = ("reproduced", "only with friction that the paper did not know of", "contradicted")
"""How a statement fares: it holds on both plants, on the observed plant alone, or not on the observed plant."""


def measure_claims(runs: Sequence[Run]) -> tuple[Claim, ...]:
    """Return the paper's statements, measured on the runs of both plants.

    Args:
        runs: of `all_runs`.
    """
    values = {plant.name: measured([run for run in runs if run.plant == plant.name]) for plant in PLANTS}
    return tuple(
        Claim(statement, {plant: each[statement.key] for plant, each in values.items()}) for statement in statements()
    )


def _pooled(errors: Sequence[Floats]) -> float:
    """Return the RMS over all samples of several errors [rad], in degrees."""
    return float(np.rad2deg(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))))


def rms(runs: Sequence[Run], series: str, estimator: str) -> float:
    """Return the RMS error of an estimator, pooled over the seeds of a series [°].

    Args:
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


_MEASURES: dict[str, Callable[[Sequence[Run]], tuple[float, ...]]] = {
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

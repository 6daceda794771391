"""The paper's statements C1 to C12, each as measures of simulated runs with thresholds that were
written down before the first run.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from distal.arrays import Floats
from distal.reports.page import resource
from distal.reports.paper_2008.series import PLANTS, SeriesRun
from distal.rig import tendon_angle_name

SIDES = ("left", "right")
"""Names of the two tendons and their sliders."""


@dataclass(frozen=True)
class Measure:
    """One measured quantity of a statement, described by `text`; it holds from `least` to `most`,
    where these are not None.
    """

    text: str
    least: float | None
    most: float | None

    def margin(self, value: float) -> float:
        """Return how far a value is inside its bound, as a share of the bound.

        The margin is negative outside the bound, and −∞ where the value is not finite.
        """
        if not np.isfinite(value):
            return -np.inf
        below = np.inf if self.least is None else (value - self.least) / abs(self.least)
        return float(
            min(below, np.inf if self.most is None else (self.most - value) / abs(self.most))
        )


@dataclass(frozen=True)
class Statement:
    """A statement of the paper.

    Args:
        key: ``C1`` to ``C12``.
        text: the statement in words.
        why: the reason for the threshold.
        reason: why it holds on a plant or not.
        measures: its measures, the main one first; all must be within their bounds.
    """

    key: str
    text: str
    why: str
    reason: str
    measures: tuple[Measure, ...]

    def margin(self, values: Sequence[float]) -> float:
        """Return the smallest margin of the measures at their `values`; the statement holds where
        it is not negative.
        """
        return min(measure.margin(value) for measure, value in zip(self.measures, values))


@lru_cache(maxsize=1)
def statements() -> tuple[Statement, ...]:
    """Return the paper's statements with the thresholds of `claims.toml`."""
    text = resource("claims.toml", "distal.reports.paper_2008")
    return tuple(
        Statement(
            key,
            main["statement"],
            main["why"],
            main["reason"],
            tuple(
                Measure(each["measure"], each.get("least"), each.get("most"))
                for each in (main, *main.get("also", ()))
            ),
        )
        for key, main in tomllib.loads(text).items()
    )


def measured(runs: Sequence[SeriesRun]) -> dict[str, tuple[float, ...]]:
    """Return key of a statement → values of its measures, from the runs of one plant."""
    return {
        key: tuple(float(value) for value in measure(runs)) for key, measure in _MEASURES.items()
    }


@dataclass(frozen=True)
class Claim:
    """A statement, and the values of its measures on each plant of the reproduction, by the plant's
    name.
    """

    statement: Statement
    values: Mapping[str, tuple[float, ...]]

    def holds(self, plant: str) -> bool:
        """Return whether the statement holds on a plant: whether all its measures are within their
        bounds.
        """
        return self.statement.margin(self.values[plant]) >= 0.0

    @property
    def group(self) -> str:
        """The one of `GROUPS` to which the statement belongs."""
        printed, observed = (self.holds(plant.name) for plant in PLANTS)
        return GROUPS[2] if not observed else GROUPS[0] if printed else GROUPS[1]


GROUPS = ("reproduced", "only with friction that the paper did not know of", "contradicted")
"""Groups of statements: those that hold on both plants, those that hold only on the plant with more
friction, and those that do not hold on the latter.
"""


def measure_claims(runs: Sequence[SeriesRun]) -> tuple[Claim, ...]:
    """Return the paper's statements with the values of their measures on both plants."""
    by_plant = {
        plant.name: measured([run for run in runs if run.plant == plant.name]) for plant in PLANTS
    }
    return tuple(
        Claim(statement, {plant: values[statement.key] for plant, values in by_plant.items()})
        for statement in statements()
    )


def _pooled(errors: Sequence[Floats]) -> float:
    """Return the RMS of several errors [rad] over all their samples [°]."""
    return float(np.rad2deg(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))))


def rms(runs: Sequence[SeriesRun], series: str, estimator: str, plant: str = "") -> float:
    """Return the RMS error of an estimator in a series, pooled over all samples and seeds [°].

    Args:
        series: name of the scenario.
        estimator: a key of `SeriesRun.estimates`.
        plant: name of the plant, where the runs are of several.
    """
    asked = [run for run in _of(runs, series) if plant in ("", run.plant)]
    return _pooled([run.estimates[estimator].errors() for run in asked])


def _of(runs: Sequence[SeriesRun], series: str) -> list[SeriesRun]:
    return [run for run in runs if run.series == series]


def potentiometer_errors(run: SeriesRun) -> tuple[Floats, Floats]:
    """Return the errors of the angles by the left and the right potentiometer [rad], (n,) each.

    The tendons are taken as inextensible.
    """
    estimate = run.estimates["inextensible"]
    left, right = (
        estimate.state(tendon_angle_name(side)) - run.log.truth["theta"] for side in SIDES
    )
    return left, right


def _potentiometer_rms(runs: Sequence[SeriesRun], series: str) -> list[float]:
    return [_pooled(errors) for errors in zip(*map(potentiometer_errors, _of(runs, series)))]


def _c1(runs: Sequence[SeriesRun]) -> tuple[float, ...]:
    return (min(_potentiometer_rms(runs, "series-1-soft")),)


def _c2(runs: Sequence[SeriesRun]) -> tuple[float, ...]:
    opposing = []
    assisting = []
    for run in _of(runs, "series-1-soft"):
        left, right = potentiometer_errors(run)
        speed = np.gradient(run.log.truth["theta"], run.log.time)
        down = speed < np.deg2rad(-2.0)
        up = speed > np.deg2rad(2.0)
        # the left tendon pulls to +θ: it opposes a falling angle
        opposing += [left[down], right[up]]
        assisting += [right[down], left[up]]
    return (_pooled(opposing) / _pooled(assisting),)


def _c3(runs: Sequence[SeriesRun]) -> tuple[float, ...]:
    soft, stiff = (
        float(np.mean(_potentiometer_rms(runs, series))) for series in ("series-1-soft", "series-1")
    )
    alike = [
        np.corrcoef(
            a.estimates["inextensible"].means[:, i], b.estimates["inextensible"].means[:, i]
        )[0, 1]
        for a, b in zip(_of(runs, "series-1-soft"), _of(runs, "series-1"))
        for i in (1, 2)
    ]
    return stiff / soft, stiff, float(np.mean(alike))


def _c4(runs: Sequence[SeriesRun]) -> tuple[float, ...]:
    truths = [run.log.truth for run in _of(runs, "series-1-soft")]
    motions = [
        hidden_motion(truth["theta"], truth[f"position_{side}"])
        for truth in truths
        for side in SIDES
    ]
    return (float(np.rad2deg(max(motions))),)


def hidden_motion(theta: Floats, position: Floats, within: float = 1e-4) -> float:
    """Return the largest change of the joint angle while a slider stays where it is [rad].

    Args:
        theta: joint angle [rad], (n,).
        position: position of the slider [m], (n,).
        within: range in which the slider counts as staying [m].
    """
    largest = 0.0
    start = 0
    for end in range(len(theta)):
        while np.ptp(position[start : end + 1]) > within:
            start += 1
        largest = max(largest, float(np.ptp(theta[start : end + 1])))
    return largest


def _ratio(
    numerator: tuple[str, str], denominator: tuple[str, str]
) -> Callable[[Sequence[SeriesRun]], tuple[float, ...]]:
    """Return a measure: the RMS error of one pair (series, estimator) divided by that of
    another.
    """
    return lambda runs: (rms(runs, *numerator) / rms(runs, *denominator),)


def _c8(runs: Sequence[SeriesRun]) -> tuple[float, ...]:
    low, high = (
        float(
            np.rad2deg(
                np.mean(
                    [run.estimates["simulation"].errors()[-50:].mean() for run in _of(runs, series)]
                )
            )
        )
        for series in ("series-2", "series-2-high")
    )
    return high, rms(runs, "series-2", "simulation"), high / low if low > 0.0 else np.nan


def _c9(runs: Sequence[SeriesRun]) -> tuple[float, ...]:
    changes = [
        run.estimates["inextensible"].means - run.estimates["without linearity"].means
        for run in _of(runs, "series-1")
    ]
    return (_pooled([change[:, i] for change in changes for i in (1, 2)]),)


_MEASURES: dict[str, Callable[[Sequence[SeriesRun]], tuple[float, ...]]] = {
    "C1": _c1,
    "C2": _c2,
    "C3": _c3,
    "C4": _c4,
    "C5": _ratio(("series-2", "ekf-2008"), ("series-2", "inextensible")),
    "C6": _ratio(("series-2-high", "inextensible"), ("series-2", "inextensible")),
    "C7": _ratio(("series-2-high", "ekf-2008"), ("series-2-high", "inextensible")),
    "C8": _c8,
    "C9": _c9,
    "C10": _ratio(("series-2", "ekf-2008"), ("series-2", "hung weights")),
    "C11": _ratio(("series-2", "better cells"), ("series-2", "ekf-2008")),
    "C12": _ratio(("series-2", "observed friction"), ("series-2", "ekf-2008")),
}

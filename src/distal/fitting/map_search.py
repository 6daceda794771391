"""How a map is learned: hyperparameters by the density of held-out logs, a band by their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED
from distal.regression import (
    Evidence,
    Prior,
    Samples,
    Shape,
    Weights,
    conformal_factor,
    evidence_of,
    features_along,
    framed,
    rates_of,
    shape_for,
)
from distal.rig import LearnedMap, MapArrays

RADIAL = 32
"""Number of radial functions. Source: benchmark (python -m benchmarks.one_map)."""

SEARCHED = (
    ("noise",),
    ("log",),
    ("log_readings", "log_slips"),
    ("radial",),
    ("slips",),
    ("readings", "lags"),
    ("filter",),
)
"""Names of the hyperparameters that move with each coordinate of the search."""

STARTS = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),  # the usual
    (0.0, 2.5, 0.0, 0.0, 0.0, 0.0, 0.0),  # logs that differ by their zeros
    (0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)
"""Coordinates where the search may begin. Source: benchmark (python -m benchmarks.one_map)."""

SPREAD = 3.0
"""Std of each coordinate over rigs. Source: benchmark (python -m benchmarks.one_map)."""

EVALUATIONS = 200
"""Largest number of sets of hyperparameters that are tried. Source: benchmark (python -m
benchmarks.one_map).
"""


def density(errors: Floats, variances: Floats) -> float:
    """Return the mean ln of the normal density of some errors, given their `variances`; 0 where
    there are none.
    """
    if not len(errors):
        return 0.0
    return float(-0.5 * np.mean(np.log(2 * np.pi * variances) + errors**2 / variances))


def moved(z: Floats) -> Prior:
    """Return the hyperparameters at the coordinates z of the search, see `SEARCHED`."""
    usual = asdict(Prior())
    changes = {name: usual[name] + step for names, step in zip(SEARCHED, z) for name in names}
    return Prior(**{**usual, **changes})


@dataclass(frozen=True)
class Task:
    """A joint's map to be learned: its logs, and the group of each, which is held out together."""

    shape: Shape
    logs: tuple[Evidence, ...]
    groups: tuple[int, ...]

    def without(self, prior: Prior) -> list[Weights]:
        """Return for each log the weights that the other groups tell."""
        others = {
            group: [log for g, log in zip(self.groups, self.logs) if g != group]
            for group in set(self.groups)
        }
        weights = {group: Weights.of(self.shape, prior, logs) for group, logs in others.items()}
        return [weights[group] for group in self.groups]

    def held_out(self, prior: Prior) -> list[tuple[Floats, Floats]]:
        """Return errors and variances on each log by the weights that the other groups tell, after
        what is given of it.
        """
        return [weights.errors(log) for weights, log in zip(self.without(prior), self.logs)]

    def densities(self, prior: Prior) -> Floats:
        """Return the density of each log by the weights that the other groups tell."""
        return np.array([density(*pair) for pair in self.held_out(prior)])

    def search(self, each: float = 1.0, lags: bool = True) -> tuple[Prior, float]:
        """Return the hyperparameters with the largest density of logs left out, with a normal prior
        around the usual ones, and −ln of that posterior density, but for a constant.

        Args:
            each: number of independent samples for which a log counts.
            lags: whether joints may follow their drives later than usual.
        """
        from scipy.optimize import minimize  # loaded late: it takes as long as all of distal

        free = np.array([lags or "lags" not in names for names in SEARCHED])

        def cost(of_free: Floats) -> float:
            z = np.zeros(len(free))
            z[free] = of_free
            try:
                without = self.without(moved(z))
                pairs = [weights.errors(log) for weights, log in zip(without, self.logs)]
                # what is given must not come as a surprise either
                pairs += [
                    weights.errors(replace(log.rows(log.given), given=np.zeros(count, bool)))
                    for weights, log in zip(without, self.logs)
                    if (count := np.count_nonzero(log.given))
                ]
            except np.linalg.LinAlgError:
                return 1e9
            densities = [density(*pair) for pair in pairs if len(pair[0])]
            total = sum(densities) * len(set(self.groups)) / len(self.logs)
            return float(0.5 * np.sum((z / SPREAD) ** 2) - each * total)

        options = {"maxfev": EVALUATIONS, "xtol": 0.1, "ftol": 1e-3}
        start = min(np.array(STARTS)[:, free], key=cost)
        found = minimize(cost, start, method="Powell", options=options)
        best = np.zeros(len(free))
        best[free] = found.x
        return moved(best), float(found.fun)


@dataclass(frozen=True)
class Seen:
    """What a map sees along some logs: the numbers of its features, and these features."""

    shape: Shape
    frame: dict[str, Floats]
    along: tuple[dict[str, Floats], ...]

    @classmethod
    def of(cls, logs: Sequence[Samples], described: Mapping[str, tuple[str, ...]]) -> Seen:
        """Return what a map sees along logs; see `learned_map`."""
        shape = shape_for(logs[0], described, RADIAL)
        frame = framed(shape, logs, Prior())
        flat = shape.flat(frame)
        along = (features_along(shape, flat, log.time, log.every) for log in logs)
        return cls(shape, frame, tuple(along))

    def task(
        self,
        logs: Sequence[Samples],
        joint: int,
        groups: Sequence[int],
        homing: float | None = None,
    ) -> tuple[Task, float, float]:
        """Return what is to be learned of a joint, and the centre and the scale of its targets; see
        `learned_map` for `homing`.
        """
        targets = np.concatenate([log.targets[:, joint] for log in logs])
        beside = self.shape.angles > 0
        centre = 0.0 if beside else float(np.nanmean(targets))
        # of an error of the filter, the angle itself is the scale
        angles = [log.angles[:, joint] if beside else 0.0 * log.time for log in logs]
        scale = max(float(np.nanstd(targets + np.concatenate(angles))), SMALLEST_SCALE)
        evidence = tuple(
            evidence_of(log, along, joint, scale, centre, homing)
            for log, along in zip(logs, self.along)
        )
        return Task(self.shape, evidence, tuple(groups)), centre, scale


@dataclass(frozen=True)
class HeldOut:
    """The errors of a joint's angle on a log [rad], (k,), by what other logs tell, their variances,
    and the time since the log's beginning [s].
    """

    time: Floats
    errors: Floats
    variances: Floats


SMALLEST_SCALE = 1e-9
"""Least scale of targets [rad, N m]. Source: rounding (division by a scale of zero)."""


def learned_map(
    logs: Sequence[Samples],
    described: Mapping[str, tuple[str, ...]],
    groups: Sequence[int],
    homing: float | None = None,
) -> tuple[LearnedMap, list[list[HeldOut]]]:
    """Return the map that logs teach, and of each joint the errors on each log by what the other
    groups tell.

    Args:
        logs: the samples of each; with one log its two halves are held out in turn.
        described: the fields of the `LearnedMap` that say what it reads and gives.
        groups: the group of each log, whose logs are held out together.
        homing: for how long the target is known in use [s]; None: it is not.
    """
    seen = Seen.of(logs, described)
    joints = range(logs[0].targets.shape[1])
    results = [_of_joint(*seen.task(logs, joint, groups, homing)) for joint in joints]
    arrays = {name: np.stack([result[name] for result, _ in results]) for name in results[0][0]}
    arrays["correlation"] = _correlation([held_out for _, held_out in results])
    every = np.vstack([log.every for log in logs])
    learned = LearnedMap(
        **described,
        beside_filter=seen.shape.angles > 0,
        logs=len(logs),
        low=tuple(np.nanmin(every, axis=0).tolist()),
        high=tuple(np.nanmax(every, axis=0).tolist()),
        **scores_of([held_out for _, held_out in results]),
        arrays=MapArrays(**seen.frame, rate=rates_of(logs, seen.frame["scale"]), **arrays),
    )
    return learned, [held_out for _, held_out in results]


def scores_of(held_out: Sequence[Sequence[HeldOut]]) -> dict[str, tuple[float, ...]]:
    """Return the scores of a `LearnedMap` by the errors of each joint on each log."""
    scores = dict[str, list[float]](rms=[], inside=[])
    for logs in held_out:
        errors = np.concatenate([log.errors for log in logs])
        variances = np.concatenate([log.variances for log in logs])
        scores["rms"].append(float(np.sqrt(np.mean(errors**2))))
        scores["inside"].append(float(np.mean(np.abs(errors) <= BAND * np.sqrt(variances))))
    return {name: tuple(values) for name, values in scores.items()}


def _correlation(held_out: Sequence[Sequence[HeldOut]]) -> Floats:
    """Return the correlation of the joints' errors on logs left out, (n_joints, n_joints); joints
    whose angles are not known at the same samples count as independent.
    """
    standardized = [
        np.concatenate([log.errors / np.sqrt(log.variances) for log in logs]) for logs in held_out
    ]
    if len({errors.shape for errors in standardized}) > 1:
        return np.eye(len(standardized))
    products = np.array(standardized) @ np.array(standardized).T
    stds = np.sqrt(np.maximum(np.diag(products), 1e-300))
    correlation: Floats = products / np.outer(stds, stds)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def _of_joint(task: Task, centre: float, scale: float) -> tuple[dict[str, Floats], list[HeldOut]]:
    """Return the arrays of a joint's map with its scores on logs left out, and its errors there."""
    evidence, groups = task.logs, len(set(task.groups))
    if groups < 2:
        halves = [np.arange(len(log.target)) < len(log.target) // 2 for log in evidence]
        parts = [log.rows(rows) for log, half in zip(evidence, halves) for rows in (half, ~half)]
        task = Task(task.shape, tuple(parts), tuple(i % 2 for i in range(len(parts))))
    prior, _ = task.search()
    held_out = task.held_out(prior)
    weights = Weights.of(task.shape, prior, evidence)
    if task.shape.angles:
        # halves of one log are more alike than two logs, so the smaller of their shares is taken
        pairs = list(zip(task.logs, held_out))
        together = [pairs] if groups > 1 else [[pair] for pair in pairs]
        share = min(_share(of_logs) for of_logs in together)
        weights = replace(weights, mean=share * weights.mean)
        held_out = [
            (log.target[~log.given] * (1 - share) + share * error, variance)
            for log, (error, variance) in zip(task.logs, held_out)
        ]
    # Student's distribution for as many logs
    factor = conformal_factor(held_out) * np.sqrt(student(groups - 1))
    square = (factor * scale) ** 2
    scored = [
        HeldOut(log.time[~log.given], scale * error, square * variance)
        for log, (error, variance) in zip(task.logs, held_out)
    ]
    mean = scale * weights.mean
    mean[0] += centre
    arrays = {
        "mean": mean,
        "covariance": square * weights.covariance,
        "radial": square * np.exp(2 * np.array(prior.radial)),
        "noise": square * np.exp(2 * np.array(prior.noise)),
        "filter": factor * np.exp(np.array(prior.filter)),
        "error_time": np.exp(np.array(prior.error_time)),
    }
    return arrays, scored


def _share(held_out: Sequence[tuple[Evidence, tuple[Floats, Floats]]]) -> float:
    """Return the share of a map's values, 0 to 1, with which it errs least on held-out logs beside
    the filter alone (stacking; Wolpert, Neural Networks 5, 1992).
    """
    with_values = [
        (log.target[~log.given], log.target[~log.given] - error) for log, (error, _) in held_out
    ]
    products = sum(float(np.mean(target * mapped)) for target, mapped in with_values if len(target))
    squares = sum(float(np.mean(mapped**2)) for _, mapped in with_values if len(mapped))
    return float(np.clip(products / max(squares, 1e-300), 0.0, 1.0))


def student(freedom: float) -> float:
    """Return the factor by which a 95 % band is wider if its std was estimated with `freedom`
    degrees of freedom, at least 1: t_{0.975}/1.96.
    """
    from scipy.special import stdtrit  # loaded late, as above

    return float(stdtrit(max(freedom, 1.0), (1 + COVERED) / 2)) / BAND


def clearly_gains(gains: Sequence[float] | Floats) -> bool:
    """Return whether the mean gain on logs held out, one of each, is above zero by more than the
    95 % band of Student's distribution.
    """
    finite = np.asarray(gains)[np.isfinite(gains)]
    freedom = len(finite) - 1
    if freedom < 1:
        return False
    error = np.std(finite) / np.sqrt(freedom)
    return bool(np.mean(finite) > BAND * student(freedom) * error)

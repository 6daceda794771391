"""Rigs that are hardly known (`benchmarks.strangers.rough_kinds`): first use without a fit, and
after a fit beside pooled least squares.

`python -m benchmarks.strangers.rough --rigs 5` prints errors and bands of each estimator from the
user's own description; `--fit` fits each rig to four logs and judges on three that no fit has seen;
`--regression` learns `regression` alone; `--learners` fits trees and a network of scikit-learn (to
be installed for it), which see the last ten samples. "linear + play" is least squares over all
fitted logs together on what the sensors read and two plays of it (0.1 and 0.4 of the travel), by
NumPy alone.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from tests.support.maps import with_learned_map
from tests.support.rough_plants import FITTED, JUDGED, KINDS

from benchmarks.report import table
from benchmarks.shell import estimate
from benchmarks.strangers.rough_kinds import described, log_at, log_of
from distal import DistalError, Log, Rig, fit
from distal.fitting import Fit
from distal.rig import build_rig

Floats = NDArray[np.float64]
Score = tuple[float, float, float]

BAND = 1.959963984540054
"""Stds of half a 95 % band."""
WIDTHS = (0.1, 0.4)
"""Of the plays, as shares of the travel."""
RIDGE = 1e-4
LOST = (90.0, 0.0, 0.0)
"""What is refused counts as this: RMS [deg], share inside, half-width [deg]."""


def angles_of(log: Log) -> Floats:
    return np.column_stack(list(log.truth.values()))


def score(log: Log, rig: Rig, estimator: str) -> Score:
    """Return RMS error [deg], share inside the 95 % band and its mean half-width [deg], of all
    joints together.
    """
    try:
        found = estimate(log, rig, estimator, compiled=False)
    except DistalError:
        return LOST
    errors, stds = found.angles - angles_of(log), found.angle_stds
    rms, half = np.sqrt(np.mean(errors**2)), BAND * np.mean(stds)
    return (
        float(np.rad2deg(rms)),
        float(np.mean(np.abs(errors) <= BAND * stds)),
        float(np.rad2deg(half)),
    )


def played(values: Floats, width: float) -> Floats:
    half, at, found = 0.5 * width * float(np.ptp(values)), float(values[0]), np.empty_like(values)
    for k, value in enumerate(values):
        at = min(max(at, value - half), value + half)
        found[k] = at
    return found


def linear_with_play(fitted: Sequence[Log]) -> Callable[[Log], Floats]:
    """Return log → angles by least squares over all fitted logs together."""

    def columns(log: Log) -> Floats:
        every = [np.ones(len(log))]
        for values in log.channels.values():
            every += [values, *(played(values, width) for width in WIDTHS)]
        return np.column_stack(every)

    whole, angles = (
        np.vstack([columns(log) for log in fitted]),
        np.vstack([angles_of(log) for log in fitted]),
    )
    scale = np.where(whole.std(axis=0) > 0.0, whole.std(axis=0), 1.0)
    x = whole / scale
    b = np.linalg.solve(x.T @ x + RIDGE * len(x) * np.eye(x.shape[1]), x.T @ angles)
    return lambda log: columns(log) / scale @ b


def first_use(kind: str, seed: int) -> list[str]:
    """Return a row: each estimator with the rig as its user describes it."""
    rig = build_rig(described(kind, seed)[0], kind)
    logs = [log_of(kind, seed, FITTED + k) for k in range(JUDGED)]
    row = [kind, str(seed)]
    for name in ("inextensible", "elastic", "adaptive"):
        scores = np.mean([score(log, rig, name) for log in logs], axis=0)
        row += [f"{scores[0]:.2f}", f"{100 * scores[1]:.0f} %", f"{scores[2]:.1f}"]
    return row


def after_fit(kind: str, seed: int) -> list[str]:
    """Return a row: the fitted rig on logs that no fit has seen, beside linear + play."""
    rig, began = build_rig(described(kind, seed)[0], kind), time.process_time()
    fitted, judged = (
        [log_of(kind, seed, k) for k in logs]
        for logs in (range(FITTED), range(FITTED, FITTED + JUDGED))
    )
    found = fit(fitted, rig)
    took = time.process_time() - began
    line = linear_with_play(fitted)
    play = np.mean([np.sqrt(np.mean((line(log) - angles_of(log)) ** 2)) for log in judged])
    ours = np.mean([score(log, found.rig, "adaptive") for log in judged], axis=0)
    row = [kind, str(seed), f"{ours[0]:.2f}", f"{100 * ours[1]:.0f} %", f"{ours[2]:.1f}"]
    row += [
        f"{np.mean([score(log, found.rig, 'regression')[0] for log in judged]):.2f}",
        f"{np.rad2deg(play):.2f}",
    ]
    row += [
        f"{np.mean([score(log, each, 'elastic')[0] for log in judged]):.1f}"
        for each in (found.rig, rig)
    ]
    return [
        *row,
        str(far_from_truth(found, described(kind, seed)[1])),
        "yes" if found.converged else "no",
        f"{took:.0f}",
    ]


RATES = (1.0, 2.4, 10.0, 40.0, 100.0, 1000.0)
"""At which the same motion is read [Hz]."""


def rates(kind: str, seed: int) -> list[str]:
    """Return a row: RMS error of `adaptive` and time for a sample at each rate, with the plant's
    own numbers.
    """
    raw, truth = described(kind, seed)
    row = [kind, str(seed)]
    for rate in RATES:
        known = {**raw, "sensors": [{**sensor, "rate": rate} for sensor in raw["sensors"]]}
        rig, log = build_rig(known, kind).with_values(truth), log_at(kind, seed, rate)
        estimate(log, rig)  # the kernel is compiled
        began = time.process_time()
        found = estimate(log, rig)
        took = 1e3 * (time.process_time() - began) / len(log)
        rms = float(np.rad2deg(np.sqrt(np.mean((found.angles - angles_of(log)) ** 2))))
        row.append(f"{rms:.2f}° ({took:.2f} ms)")
    return row


def far_from_truth(found: Fit, truth: Mapping[str, float]) -> int:
    """Return how many fitted numbers are more than 3 stated errors from the plant's, and are named
    in no doubt.

    A rolling joint has no axle, and other arms than its user takes for the pulleys': its
    stiffnesses alone are compared.
    """
    said = " ".join(found.doubts)
    if "rolling" in found.rig.name:
        truth = {path: value for path, value in truth.items() if path.endswith(".stiffness")}
    return sum(
        abs(part.value - truth[part.paths[0]]) > 3.0 * part.error
        for part in found.fitted
        if not part.noise and part.paths[0] in truth and part.name not in said
    )


def lines_alone(kind: str, seed: int) -> list[str]:
    """Return a row: `regression` learned from the same logs beside linear + play, on logs that
    neither has seen.
    """
    rig = build_rig(described(kind, seed)[0], kind)
    fitted, judged = (
        [log_of(kind, seed, k) for k in logs]
        for logs in (range(FITTED), range(FITTED, FITTED + JUDGED))
    )
    began = time.process_time()
    learned, line = with_learned_map(fitted, rig, "readings"), linear_with_play(fitted)
    took = time.process_time() - began
    scores = np.mean([score(log, learned, "regression") for log in judged], axis=0)
    play = np.mean([np.sqrt(np.mean((line(log) - angles_of(log)) ** 2)) for log in judged])
    return [
        kind,
        str(seed),
        f"{scores[0]:.2f}",
        f"{100 * scores[1]:.0f} %",
        f"{np.rad2deg(play):.2f}",
        f"{took:.1f}",
    ]


PAST = 10
"""Samples that the learners see: this one and those before."""


def learners(kind: str, seed: int) -> list[str]:
    """Return a row: what models without mechanics make of the same logs, on logs that they have not
    seen.
    """
    from sklearn.ensemble import ExtraTreesRegressor
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    def past(log: Log) -> Floats:
        now = np.column_stack(list(log.channels.values()))
        return np.hstack(
            [np.vstack([now[:1].repeat(k, axis=0), now[: len(now) - k]]) for k in range(PAST)]
        )

    fitted, judged = (
        [log_of(kind, seed, k) for k in logs]
        for logs in (range(FITTED), range(FITTED, FITTED + JUDGED))
    )
    x, y = np.vstack([past(log) for log in fitted]), np.vstack([angles_of(log) for log in fitted])
    network = MLPRegressor(
        hidden_layer_sizes=(64, 64), alpha=1e-3, early_stopping=True, max_iter=500, random_state=0
    )
    models = [ExtraTreesRegressor(300, min_samples_leaf=3, n_jobs=1, random_state=0), network]
    row, mean, std = [kind, str(seed)], y.mean(axis=0), y.std(axis=0)
    for model in models:
        made = make_pipeline(StandardScaler(), model).fit(x, (y - mean) / std)
        errors = [
            made.predict(past(log)).reshape(len(log), -1) * std + mean - angles_of(log)
            for log in judged
        ]
        row.append(f"{np.rad2deg(np.mean([np.sqrt(np.mean(error**2)) for error in errors])):.2f}")
    return row


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.strangers.rough", description=__doc__
    )
    parser.add_argument("--rigs", type=int, default=5, help="of each kind (5)")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=KINDS)
    parser.add_argument("--fit", action="store_true", help="after a fit; else first use")
    parser.add_argument(
        "--regression", action="store_true", help="regression alone beside linear + play"
    )
    parser.add_argument(
        "--learners",
        action="store_true",
        help="trees and a network of scikit-learn on the same logs",
    )
    parser.add_argument(
        "--rates", action="store_true", help="the same motion read at 1 to 1000 Hz, numbers known"
    )
    given = parser.parse_args()
    made = (
        after_fit
        if given.fit
        else lines_alone
        if given.regression
        else learners
        if given.learners
        else rates
        if given.rates
        else first_use
    )
    warnings.simplefilter("ignore")  # what a fit warns of is what is judged here
    rows = list[list[str]]()
    for kind in given.kinds:
        for seed in range(given.rigs):
            rows.append(made(kind, seed))
            print(*rows[-1], flush=True)
    three = [
        f"{name} {what}"
        for name in ("inextensible", "elastic", "adaptive")
        for what in ("°", "inside", "±")
    ]
    more = ["fitted °", "inside", "±", "regression °", "linear + play °", "elastic °", "before °"]
    more += ["> 3 errors", "converged", "s"]
    title, name, columns = "first use, without a fit", "rough", three
    if given.fit:
        title, name, columns = "after a fit", "rough-fitted", more
    elif given.regression:
        title, name, columns = (
            "regression alone",
            "rough-regression",
            ["regression °", "inside", "linear + play °", "s"],
        )
    elif given.learners:
        title, name, columns = (
            "models without mechanics",
            "rough-learners",
            ["trees °", "network °"],
        )
    elif given.rates:
        title, name, columns = "rates", "rough-rates", [f"{rate:g} Hz" for rate in RATES]
    table(name, f"rigs that are hardly known: {title}", ["kind", "rig", *columns], rows)


if __name__ == "__main__":
    main()

"""What a touch does to the angle: rigs that the command fitted in free motion, then touched.

`python -m benchmarks.touch [--first-seed 5000] [--only finger-2n]` draws logs of plants that share
no code with `distal.model`, fits by `distal fit` with a file to read, and judges it on logs that no
fit has seen: free motion, walls and pushes. Beside it stand least squares of the same calibration
logs (the best yardstick by their own cross-validation), and the same filter with no touch looked
for. The sheath joint and the finger of three tendons need the folder of logs in `DISTAL_DATA`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.chain_logs import make_log
from benchmarks.newcomers import newcomer
from benchmarks.report import table
from benchmarks.strangers.coupled_finger import JOINTS, Touch, finger_log, postures
from distal import Estimate, LiveEstimator, Log, Rig, estimate, load_rig, read_log
from distal.estimators import samples_of_angles
from distal.fitting.learned_maps import efforts_of
from distal.logs import write_columns
from distal.regression import YARDSTICKS, Samples, yardstick_error
from distal.run import Monitor

Floats = NDArray[np.float64]

TOUCHED = 1e-3
"""Torque from which on a joint counts as touched [N m]."""

AFTER = 1.0
"""For so long after a touch its samples are counted with it [s]."""

WRONG_STDS, WRONG = 3.0, np.deg2rad(1.0)
"""A sample is wrong that errs by more than so many stated stds and by more than so much [rad]."""

DURATION = 20.0


@dataclass(frozen=True)
class Drawn:
    """A rig with its logs as files: for calibration, in free motion, and touched."""

    rig: Path
    calibration: tuple[Path, ...]
    free: tuple[Path, ...]
    touched: tuple[Path, ...]


def _drawn(
    rig: Path, folder: Path, columns_of: Callable[..., dict[str, Floats]], **motions: Sequence[Any]
) -> Drawn:
    """Return a rig whose logs of each kind are written from motions, of which the touched ones have
    what they meet; numbered over all kinds.
    """
    paths: dict[str, list[Path]] = {kind: [] for kind in motions}
    for k, (kind, motion) in enumerate((kind, m) for kind, of in motions.items() for m in of):
        met = motion if kind == "touched" else (motion, None)
        columns = columns_of(k, kind == "calibration", *met)
        paths[kind].append(_written(folder / f"{kind}_{k}.csv", columns))
    return Drawn(rig, **{kind: tuple(of) for kind, of in paths.items()})


def sheath_joint(seed: int, folder: Path) -> Drawn:
    """Return the joint of two Bowden sheaths: currents only."""
    plant, rng = newcomer("sheath_joint"), np.random.default_rng(seed)

    def wall(at: float, stiffness: float, push: float, start: float) -> Callable[..., float]:
        def torque(time: float, angle: float, speed: float) -> float:
            beyond = angle - at
            force = min(0.0, -(stiffness * beyond + 0.01 * speed)) if beyond > 0.0 else 0.0
            return force + _pushed(push, start, time)

        return torque

    def columns_of(k: int, with_reference: bool, reference: Any, outside: Any) -> dict[str, Floats]:
        rows, truth = plant.simulate(reference, DURATION, seed + 10 * k, outside)
        columns = dict(zip(plant.HEAD.split(","), rows.T))
        if not with_reference:
            del columns["angle_deg"]
            columns["true_theta"] = np.deg2rad(truth[:, 1])
            columns["true_external_torque"] = truth[:, 2]
        return columns

    walls = [
        wall(np.deg2rad(rng.uniform(0, 22)), rng.uniform(0.7, 4.0), push, rng.uniform(3, 15))
        for push in rng.uniform(-0.07, 0.07, 4)
    ]
    return _drawn(
        Path(os.environ["DISTAL_DATA"]) / "newcomer" / "sheath_joint.toml",
        folder,
        columns_of,
        calibration=[
            plant.sine(38, 0.2, 0.0, 0.15),
            plant.smooth(seed + 1, 40, 1.1, (-0.1, 0.35)),
            plant.ramps(seed + 2, 40, 60.0, (-0.1, 0.3)),
            plant.ramps(seed + 3, 35, 25.0, (0.0, 0.2)),
        ],
        free=[plant.steps(seed + 4, 32, 1.25), plant.smooth(seed + 5, 35, 1.2, (0.0, 0.3))],
        touched=[
            (plant.smooth(seed + 6 + k, 30, 1.4, (0.0, 0.2)), outside)
            for k, outside in enumerate(walls)
        ],
    )


def three_tendons(seed: int, folder: Path) -> Drawn:
    """Return the finger of two joints and three tendons with load cells."""
    plant, rng = newcomer("three_tendons"), np.random.default_rng(seed)

    def ball(at: float, stiffness: float, push: float, start: float) -> Callable[..., Any]:
        def torques(time: float, q1: float, q2: float, w1: float, w2: float) -> Any:
            beyond = q1 + q2 - at
            force = min(0.0, -(stiffness * beyond + 4e-4 * (w1 + w2))) if beyond > 0.0 else 0.0
            return 2.2 * force + _pushed(push, start, time), force

        return torques

    def columns_of(k: int, with_reference: bool, reference: Any, outside: Any) -> dict[str, Floats]:
        rows, truth = plant.simulate(reference, DURATION, seed + 10 * k, outside)
        columns = dict(zip(plant.HEAD.split(","), rows.T))
        if not with_reference:
            for j, joint in enumerate(("mcp", "pip")):
                del columns[f"{joint}_deg"]
                columns[f"true_theta_{joint}"] = np.deg2rad(truth[:, 1 + j])
                columns[f"true_external_torque_{joint}"] = truth[:, 3 + j]
        return columns

    balls = [
        ball(np.deg2rad(rng.uniform(60, 85)), rng.uniform(0.06, 0.6), push, rng.uniform(3, 15))
        for push in rng.uniform(-0.03, 0.03, 4)
    ]
    return _drawn(
        Path(os.environ["DISTAL_DATA"]) / "newcomer" / "three_tendons.toml",
        folder,
        columns_of,
        calibration=[
            plant.lissajous(0.21, 0.33),
            plant.smooth(seed + 1, 1.1),
            plant.ramps(seed + 2, 110.0),
            plant.ramps(seed + 3, 50.0),
        ],
        free=[plant.steps(seed + 4, 1.2), plant.smooth(seed + 5, 1.2)],
        touched=[(plant.smooth(seed + 6 + k, 1.3), outside) for k, outside in enumerate(balls)],
    )


PACES = ((1.1, 0.8), (2.5, 2.3), (0.9, 0.4), (1.6, 0.9))
"""How long the postures of a calibration log are held, and how long the way to them takes [s]."""


def coupled_finger(seed: int, folder: Path) -> Drawn:
    """Return the finger of three joints that two servos move: counts and currents only."""
    rng = np.random.default_rng(seed)

    def touch() -> Touch:
        pushes = np.zeros(3)
        pushes[rng.integers(3)] = rng.uniform(-0.06, 0.06)
        object_at, stiffness = rng.uniform(1.2, 2.2), rng.uniform(0.01, 0.06)
        return Touch(stiffness, object_at, tuple(pushes), rng.uniform(3, 15))

    def columns_of(k: int, with_reference: bool, goals: Any, met: Any) -> dict[str, Floats]:
        columns, truth = finger_log(goals, DURATION, seed + 10 * k, met)
        if not with_reference:
            for joint in JOINTS:
                del columns[f"{joint}_deg"]
            columns |= {f"true_{name}": values for name, values in truth.items()}
        return columns

    return _drawn(
        Path(__file__).parent / "strangers" / "coupled_finger.toml",
        folder,
        columns_of,
        calibration=[
            postures(seed + k, DURATION, hold, blend) for k, (hold, blend) in enumerate(PACES)
        ],
        free=[postures(seed + 14, DURATION, 1.25, 0.1), postures(seed + 15, DURATION, 1.3, 0.9)],
        touched=[(postures(seed + 16 + k, DURATION, 1.4, 0.9), touch()) for k in range(4)],
    )


def chain(name: str, plant: str, seed: int, folder: Path) -> Drawn:
    """Return a chain in another simulator: torques on one joint at a time."""
    rig = load_rig(name)

    def write(kind: str, of: str, k: int) -> Path:
        columns, truth = make_log(plant, of, seed + k, instrument=seed)
        known = {f"true_{key}": values for key, values in truth.items() if key.startswith("theta")}
        torques = [key for key in truth if "torque" in key or key.startswith("tau")]
        for key, joint in zip(torques, rig.joints):
            known[f"true_external_torque_{joint.name}"] = truth[key]
        return _written(folder / f"{kind}_{k}.csv", {**columns, **known})

    path = folder / "rig.toml"
    text = subprocess.run(
        [sys.executable, "-m", "distal", "rig", "show", name],
        capture_output=True,
        text=True,
        check=True,
    )
    path.write_text(text.stdout, encoding="utf-8")
    kinds = ("servo", "step", "servo", "step")
    return Drawn(
        path,
        tuple(write("calibration", kind, k) for k, kind in enumerate(kinds)),
        tuple(write("free", kind, 4 + k) for k, kind in enumerate(("servo", "step"))),
        tuple(write("touched", "contact", 6 + k) for k in range(4)),
    )


CASES: dict[str, Callable[[int, Path], Drawn]] = {
    "sheath joint, currents": sheath_joint,
    "finger, three tendons": three_tendons,
    "finger, two servos": coupled_finger,
    "finger-2n": lambda seed, folder: chain("finger-2n", "finger2N", seed, folder),
    "finger-n-plus-1": lambda seed, folder: chain("finger-n-plus-1", "finger_n1", seed, folder),
    "wrist-instrument": lambda seed, folder: chain(
        "wrist-instrument", "wrist_instrument", seed, folder
    ),
}


def _pushed(push: float, start: float, time: float) -> float:
    """Return a push of 3 s that comes and goes within 0.1 s [N m]."""
    if not start < time < start + 3.0:
        return 0.0
    return push * min(1.0, (time - start) / 0.1) * min(1.0, (start + 3.0 - time) / 0.1)


def _written(path: Path, columns: dict[str, Floats]) -> Path:
    write_columns(columns, path)
    return path


@dataclass(frozen=True)
class Judged:
    """Squared errors and whether they are inside the band, (k, n_joints) each, which samples are
    touched or wrong, (k,), and the median half-width of the band [°].
    """

    squares: Floats
    inside: NDArray[np.bool_]
    touched: NDArray[np.bool_]
    wrong: NDArray[np.bool_]
    half: float

    @classmethod
    def of(cls, result: Estimate, log: Log) -> Judged:
        """Return how an estimate did on a log that knows angles and torques."""
        errors = result.errors().reshape(len(log), -1)
        stds = result.angle_stds
        wrong = (np.abs(errors) > WRONG_STDS * stds) & (np.abs(errors) > WRONG)
        return cls(
            np.rad2deg(errors) ** 2,
            np.abs(errors) <= 1.96 * stds,
            is_touched(result, log),
            wrong.any(axis=1),
            float(np.rad2deg(1.96 * np.median(stds))),
        )


def is_touched(result: Estimate, log: Log) -> NDArray[np.bool_]:
    """Return which samples are touched, or come less than `AFTER` after a touch, (k,)."""
    if result.torque_truths is None:
        return np.zeros(len(log), dtype=bool)
    now = (np.abs(result.torque_truths) > TOUCHED).any(axis=1)
    since, touched = np.inf, np.zeros(len(log), dtype=bool)
    for k, step in enumerate(np.diff(log.time, prepend=log.time[0])):
        since = 0.0 if now[k] else since + step
        touched[k] = since < AFTER
    return touched


def fitted(drawn: Drawn, folder: Path) -> Rig:
    """Return the rig that the command writes."""
    out = folder / "fitted.toml"
    command = [sys.executable, "-m", "distal", "fit", *map(str, drawn.calibration)]
    subprocess.run(
        [*command, "--rig", str(drawn.rig), "--out", str(out)], capture_output=True, check=True
    )
    return load_rig(out)


def best_line(calibration: Sequence[Samples], others: Sequence[Samples]) -> list[float]:
    """Return the RMS errors on other logs [°] of the yardstick that errs least on each calibration
    log by the rest of them.
    """

    def left_out(name: str) -> float:
        errors = [
            yardstick_error(name, [*calibration[:k], *calibration[k + 1 :]], samples)
            for k, samples in enumerate(calibration)
        ]
        return float(np.sqrt(np.mean(np.square(errors))))

    best = min(YARDSTICKS, key=left_out)
    return [float(np.rad2deg(yardstick_error(best, calibration, samples))) for samples in others]


def onsets(rig: Rig, log: Log) -> int:
    """Return how many touches begin, as a stream reports them."""
    monitor = Monitor(LiveEstimator(rig))
    samples = np.column_stack([log.channels[name] for name in monitor.channels])
    begun, before = 0, False
    for time, sample in zip(log.time, samples):
        now = any(contact.since > 0.0 for contact in monitor.take(float(time), sample).contacts)
        begun, before = begun + (now and not before), now
    return begun


def judged(name: str, seed: int) -> list[str]:
    """Return the row of one rig."""
    with tempfile.TemporaryDirectory() as position:
        folder = Path(position)
        drawn = CASES[name](seed, folder)
        rig = fitted(drawn, folder)
        closed = rig.with_values({"joints.*.touch": "never"})
        logs = {
            kind: [read_log(path, rig) for path in paths]
            for kind, paths in (("free", drawn.free), ("touched", drawn.touched))
        }
        calibration = [samples_of_angles(read_log(path, rig), rig) for path in drawn.calibration]
        lines = {
            kind: best_line(calibration, [samples_of_angles(log, rig) for log in group])
            for kind, group in logs.items()
        }
        runs = {
            kind: [Judged.of(estimate(log, rig), log) for log in group]
            for kind, group in logs.items()
        }
        before = {
            kind: [Judged.of(estimate(log, closed), log) for log in group]
            for kind, group in logs.items()
        }
        minutes = sum(float(np.ptp(log.time)) for log in logs["free"]) / 60
        false = sum(onsets(rig, log) for log in logs["free"])
    touched = [run.inside[run.touched] for run in runs["touched"]]
    wrong = np.concatenate([run.wrong for run in runs["touched"]])
    return [
        name,
        "/".join(f"{_rms(group['free']):.3f}" for group in (runs, before)),
        f"{_half(runs['free']) / _half(before['free']):.2f}",
        "/".join(
            f"{value:.3f}"
            for value in (
                _rms(runs["touched"]),
                _rms(before["touched"]),
                float(np.sqrt(np.mean(np.square(lines["touched"])))),
            )
        ),
        "/".join(
            f"{100 * np.mean(np.concatenate([run.inside for run in group])):.0f} %"
            for group in (runs["touched"], before["touched"])
        ),
        f"{100 * np.mean(np.concatenate(touched)):.0f} %",
        f"{100 * np.mean(wrong):.1f} %",
        f"{false} in {minutes:.1f} min",
    ]


def _half(runs: Sequence[Judged]) -> float:
    return float(np.mean([run.half for run in runs]))


def _rms(runs: Sequence[Judged]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([run.squares for run in runs]))))


def figure(path: Path) -> None:
    """Draw a push on a finger: angles with and without the touch looked for, and its torque."""
    import matplotlib.pyplot as plt
    from tests.support.pushed_finger import finger, finger_rig

    described = finger_rig().with_values({"joints.finger.external_torque.std": 0.0})
    calm = [finger(seed, 12.0, None)[0] for seed in range(3)]
    rig = described.with_map(efforts=efforts_of(calm, described, range(len(calm))))
    log = finger(7, 11.0, 6.0)[0]
    result = estimate(log, rig)
    never = estimate(log, rig.with_values({"joints.finger.touch": "never"}))
    shown = log.time >= 4.0
    time, true = log.time[shown], np.rad2deg(log.truth["theta"][shown])
    fig, (above, below) = plt.subplots(2, sharex=True, figsize=(7.0, 4.2), layout="constrained")
    angle, half = (
        np.rad2deg(result.angles[shown, 0]),
        np.rad2deg(1.96 * result.angle_stds[shown, 0]),
    )
    above.fill_between(time, angle - half, angle + half, color="0.85", label="95 % band")
    above.plot(
        time, np.rad2deg(never.angles[shown, 0]), "--", color="#d55e00", label="never touched"
    )
    above.plot(time, angle, color="#0072b2", label="estimate")
    above.plot(time, true, ":", color="black", label="true")
    above.set_ylabel("angle [°]")
    above.legend(fontsize=8, loc="lower right")
    torque = 1e3 * result.external_torque[shown]
    below.plot(time, torque, color="#0072b2", label="estimate")
    below.plot(time, 1e3 * log.truth["external_torque"][shown], ":", color="black", label="true")
    below.set(xlabel="time [s]", ylabel="torque [mN m]")
    for axes in (above, below):
        axes.axvspan(6.0, 9.0, color="#56b4e9", alpha=0.15, linewidth=0)
        axes.spines[["top", "right"]].set_visible(False)
    fig.savefig(path)


COLUMNS = (
    "rig",
    "free, RMS now/never [°]",
    "half-width now/never",
    "touched, RMS now/never/least squares [°]",
    "inside now/never",
    "touched and 1 s after",
    "wrong",
    "false touches",
)


def main() -> None:
    """Run, print and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, default=5000)
    parser.add_argument("--only", choices=list(CASES), action="append")
    parser.add_argument("--figure", type=Path, help="draw a push to this file instead")
    arguments = parser.parse_args()
    if arguments.figure is not None:
        figure(arguments.figure)
        return
    names = arguments.only or [
        name
        for name in CASES
        if "DISTAL_DATA" in os.environ or not name.startswith(("sheath", "finger, three"))
    ]
    rows = [judged(name, arguments.first_seed) for name in names]
    table(
        "touch", f"Fitted in free motion, then touched; seed {arguments.first_seed}", COLUMNS, rows
    )


if __name__ == "__main__":
    main()

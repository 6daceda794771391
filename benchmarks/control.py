"""Control on the estimate: how well a joint without an encoder keeps to its reference, beside one
with one of 1°.

`python -m benchmarks.control` draws plants from the stds of `paper-2008-observed` and controls each
in `control-paper` by an encoder, by `adaptive` with the rig as it came, by `adaptive` with the rig
fitted to one log that the encoder's loop left, and by displacements alone; then `finger-2n` in
MuJoCo, whose plants share no code with the model.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from tests.support.chain_plants import PLANTS, STEP, build_model, draw_truth
from tests.support.commands import constant_parts

from benchmarks.report import table
from benchmarks.shell import written
from benchmarks.strangers.random_rigs import drawn_plant
from distal import Log, Rig, load_scenario, scenario_rig
from distal.control import PID, ClosedLoop, closed_loop, run_controller, trackings_of
from distal.simulation import Scenario

Floats = NDArray[np.float64]


PERIOD = 0.005
FIRST = 20
"""Seed of the first plant; the gains and the dead band were chosen on earlier ones."""
OTHER = [
    ["0 s", "0 deg"],
    ["2 s", "15 deg"],
    ["4 s", "15 deg"],
    ["7 s", "-18 deg"],
    ["9 s", "-5 deg"],
    ["10 s", "-5 deg"],
    ["11 s", "20 deg"],
    ["13 s", "0 deg"],
    ["16 s", "-20 deg"],
    ["18 s", "10 deg"],
]
"""The motion of the calibration: another one than is judged."""


def figures(run: ClosedLoop) -> tuple[float, float, int]:
    """Return RMS of tracking, and of the told angle's error, of all joints [deg], and how many
    limit cycles there are.
    """
    each = trackings_of(run)
    rms, wrong = (
        float(np.rad2deg(np.sqrt(np.mean(np.square(values)))))
        for values in ([one.rms for one in each], [one.estimate_rms for one in each])
    )
    return rms, wrong, limit_cycles(run)


def limit_cycles(run: ClosedLoop) -> int:
    """Return how often a joint moves by more than 0.3° in the last 2 s of a time in which all
    references are constant, its first second left out.
    """
    count = 0
    for begin, end in constant_parts(run.time, *run.references.values()):
        stamps = run.time[begin:end]
        late = stamps >= max(stamps[-1] - 2.0, stamps[0] + 1.0)
        if stamps[-1] - stamps[0] >= 2.0 - 1.5 * (stamps[1] - stamps[0]):
            joints = [run.rig.joint_names.index(name) for name in run.references]
            motions = np.ptp(run.angles[begin:end, joints][late], axis=0)
            count += int(np.sum(motions > np.deg2rad(0.3)))
    return count


def with_plant(
    scenario: Scenario, values: Mapping[str, object], reference: object = None
) -> Scenario:
    """Return the scenario with a plant's own numbers, and another reference where one is given."""
    changed = scenario.model_copy(update={"plant": {**scenario.plant, **values}})
    if reference is None or scenario.control is None:
        return changed
    (name, joint), *_ = scenario.control.joints.items()
    other = type(joint).model_validate({**joint.model_dump(), "reference": reference})
    return changed.model_copy(
        update={"control": scenario.control.model_copy(update={"joints": {name: other}})}
    )


Found = dict[str, list[tuple[float, float, int]]]
"""By feedback what `figures` says of each plant."""


def summary(found: Found) -> list[list[str]]:
    """Return a row for each feedback: medians over the plants, beside those with an encoder."""
    rows, base = [], np.array([rms for rms, _, _ in found["encoder"]])
    for name, each in found.items():
        rms, wrong, cycles = (np.array(column) for column in zip(*each))
        ratio = rms / base
        parameters = [np.median(rms), np.median(ratio), ratio.max(), np.median(wrong)]
        rows.append(
            [
                name,
                *(f"{value:.2f}" for value in parameters),
                f"{int(np.sum(cycles > 0))} of {len(cycles)}",
            ]
        )
    return rows


def paper(plants: int) -> Found:
    """Return the figures of plants of the paper's rig."""
    scenario = load_scenario("control-paper")
    rig, found = scenario_rig(scenario), Found()
    for seed in range(FIRST, FIRST + plants):
        judged = with_plant(scenario, drawn_plant(rig, seed, 81))
        log = closed_loop(rig, with_plant(judged, {}, OTHER), seed + 100, feedback="encoder").log
        fitted = written(rig, [log], "fit")
        for name, used in (
            ("encoder", rig),
            ("adaptive", rig),
            ("adaptive, fitted", fitted),
            ("ratio", rig),
        ):
            each = figures(closed_loop(used, judged, seed, feedback=name.partition(",")[0]))
            found.setdefault(name, []).append(each)
            print("paper", seed, name, *each, flush=True)
    return found


class Finger:
    """`finger-2n` in MuJoCo, as a plant that a controller drives."""

    def __init__(self, rig: Rig, seed: int, duration: float) -> None:
        self.rig, self._of, self._duration = rig, PLANTS["finger2N"], duration
        self._truth = draw_truth(self._of, np.random.default_rng([seed, 82]))
        self._model = build_model(self._of, self._truth.springs)
        n, winding = len(self._of.joints), np.array(self._of.drives.winding)
        self._stretching = np.hstack([-self._truth.arms, winding])
        factors = np.append(self._truth.joint_friction, self._truth.drive_friction)
        joints = [joint.friction_constant for joint in self._of.joints]
        self._constant = factors * np.append(
            joints, [self._of.drives.friction_constant] * winding.shape[1]
        )
        per_joint = np.array([joint.friction_radius for joint in self._of.joints]) * (
            self._truth.arms != 0
        )
        share = np.hstack([per_joint, self._of.drives.friction_share * np.abs(winding)])
        self._per_tension, self._n = factors[:, None] * share.T, n

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return PERIOD * self._done

    @property
    def finished(self) -> bool:
        """Whether the scenario is over."""
        return self.time >= self._duration - 1e-9

    @property
    def angles(self) -> Floats:
        """True angles [rad]."""
        return np.array(self._data.qpos[: self._n])

    def reset(self, seed: int = 0) -> list[tuple[float, Floats]]:
        """Begin at rest, each tendon pulled by 8 N."""
        self._data, self._rng, self._done = (
            mujoco.MjData(self._model),
            np.random.default_rng([seed, 83]),
            0,
        )
        self._data.qpos[: self._n] = [joint.initial.value for joint in self.rig.joints]
        self._data.qpos[self._n :] = self._truth.arms @ self.angles + 8.0 / self._truth.stiffness
        self._efforts, self._rows = np.full(4, 8.0), list[Floats]()
        self._bends = self._rng.uniform(0.3, 1.0, 4), self._rng.uniform(0, 2 * np.pi, 4)
        self._go(int(0.5 / STEP))
        return [self._sample()]

    def step(self, commands: Mapping[str, float]) -> list[tuple[float, Floats]]:
        """Go on by 5 ms."""
        self._efforts = np.array([max(commands.get(f, 8.0), 0.0) for f in self._of.drives.names])
        self._go(round(PERIOD / STEP))
        self._done += 1
        return [self._sample()]

    def _go(self, steps: int) -> None:
        data, k = self._data, self._truth.stiffness
        for _ in range(steps):
            tensions = k * np.maximum(self._stretching @ data.qpos, 0.0)
            data.qfrc_applied[:] = -self._stretching.T @ tensions
            data.qfrc_applied[self._n :] += self._efforts
            self._model.dof_frictionloss[:] = self._constant + self._per_tension @ tensions
            mujoco.mj_step(self._model, data)

    def _sample(self) -> tuple[float, Floats]:
        positions, (size, phase) = np.array(self._data.qpos[self._n :]), self._bends
        read = (
            positions
            + 1e-4 * size * np.sin(2 * np.pi * positions / 0.02 + phase)
            + 5e-6 * self._rng.normal(size=4)
        )
        values = np.concatenate([read, self._efforts + 0.2 * self._rng.normal(size=4)])
        self._rows.append(np.concatenate([values, self.angles]))
        return self.time, values

    def log(self) -> Log:
        """Return what was read."""
        rows = np.array(self._rows)
        names = [sensor.name for sensor in self.rig.sensors]
        truth = {f"theta_{joint.name}": rows[:, 8 + j] for j, joint in enumerate(self.rig.joints)}
        return Log(PERIOD * np.arange(len(rows)), dict(zip(names, rows.T)), truth, "MuJoCo")


def finger(plants: int) -> Found:
    """Return the figures of plants of the finger in MuJoCo."""
    scenario, found = load_scenario("control-finger"), Found()
    rig, control = scenario_rig(scenario), scenario.control
    assert control is not None
    for seed in range(FIRST, FIRST + plants):
        for name in ("encoder", "adaptive", "ratio"):
            pid = PID(rig, control.joints, PERIOD, control.co_contraction)
            run = run_controller(Finger(rig, seed, scenario.duration), pid, name, seed)
            references = {
                joint: one.reference.at(run.time) for joint, one in control.joints.items()
            }
            found.setdefault(name, []).append(figures(replace(run, references=references)))
            print("finger", seed, name, *found[name][-1], flush=True)
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.control", description=__doc__)
    parser.add_argument("--plants", type=int, default=10, help="of each rig (10)")
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # fits to one log warn of what it does not tell
    columns = [
        "feedback",
        "RMS [°]",
        "over encoder, median",
        "worst",
        "told wrong by [°]",
        "plants with a limit cycle",
    ]
    for name, found in (("paper", paper(given.plants)), ("finger", finger(given.plants))):
        table(f"control-{name}", f"{name}: {given.plants} plants, medians", columns, summary(found))


if __name__ == "__main__":
    main()

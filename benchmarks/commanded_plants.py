"""Plants behind the servos of `tests/support/servo_plants`: `Disk` is the paper's joint; `Bowden`
and `Chain` step the plants of `hands_plants` and `chain_plants`. Numbers are drawn within what
their users' rig files leave open.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from tests.support import chain_plants, hands_plants
from tests.support.cable import Cable
from tests.support.hands_plants import ARM, SLACK, SPOOL, STIFFNESS, turned
from tests.support.servo_plants import PARTS, PERIOD, Ropes, with_servos

from benchmarks.chain_logs import COUNT
from distal import load_rig

Floats = NDArray[np.float64]


class Disk:
    """The paper's joint: two nylon tendons pinned to a disk, axle friction that grows faster than
    its load.
    """

    def __init__(self, seed: int) -> None:
        self.rig = with_servos(load_rig("paper-2008-observed"))
        rng = np.random.default_rng([seed, 91])
        self.stiffness = 806.0 * (1 + 0.1 * rng.uniform(-1, 1)) * (1 + 0.01 * rng.uniform(-1, 1, 2))
        self.friction, self.slider = 1 + 0.2 * rng.uniform(-1, 1), 1 + 0.2 * rng.uniform(-1, 1, 2)
        self.inertia, self.damping = 4.239e-4, 8e-3 * (1 + 0.2 * rng.uniform(-1, 1))
        self.angles, self.speed = np.zeros(1), 0.0
        self.positions, self.rates, self.rng = np.full(2, 2.5e-3), np.zeros(2), rng
        waves, phases = (
            rng.uniform(0.3, 1.0, (2, 3)) / [1.0, 1.5, 3.0],
            rng.uniform(0, 2 * pi, (2, 3)),
        )
        grid = np.linspace(-2.5e-3, 7.5e-3, 200)
        heights = [np.abs(self._wave(grid, w, f)).max() for w, f in zip(waves, phases)]
        scale = 1e-4 * rng.uniform(0.4, 1.0, 2) / heights
        self.curve = [(scale[i] * waves[i], phases[i]) for i in range(2)]

    @staticmethod
    def _wave(positions: Any, weights: Floats, phases: Floats) -> Any:
        lengths = 2 * pi / np.array([0.02, 0.01, 0.005])
        return np.sin(np.multiply.outer(positions, lengths) + phases) @ weights

    def errors(self, positions: Floats) -> Floats:
        """Return what the potentiometers err by, smooth over the travel."""
        return np.array([float(self._wave(positions[i], *self.curve[i])) for i in range(2)])

    def tensions(self) -> tuple[list[float], list[float]]:
        """Return the tendons' tensions and their moment arms."""
        angle, radius, length = float(self.angles[0]), 9.53e-3, 0.375
        pulls, arms = [], []
        for position, side, stiffness in zip(
            self.positions.tolist(), (1.0, -1.0), self.stiffness.tolist()
        ):
            across, along = (
                radius * (1 - cos(angle)),
                length + position - side * radius * sin(angle),
            )
            now = sqrt(across * across + along * along)
            pulls.append(stiffness * max(now - length, 0.0))
            arms.append(-(across * radius * sin(angle) - along * side * radius * cos(angle)) / now)
        return pulls, arms

    def move(self, positions: Floats) -> None:
        """Move the sliders within 1 ms, the disk in steps of 0.25 ms."""
        before, steps, dt = self.positions, 4, PERIOD / PARTS / 4
        self.rates = (positions - before) / (PERIOD / PARTS)
        for k in range(1, steps + 1):
            self.positions = before + (positions - before) * k / steps
            pulls, arms = self.tensions()
            limit = self.friction * 0.5 * 3.18e-3 * 15.2 * ((5.1 + sum(pulls)) / 15.2) ** 1.83
            free = self.speed + dt / self.inertia * (
                pulls[0] * arms[0] + pulls[1] * arms[1] - self.damping * self.speed
            )
            most = dt / self.inertia * limit
            self.speed = max(free - most, 0.0) + min(free + most, 0.0)
            self.angles = self.angles + dt * self.speed

    def read(self) -> dict[str, float]:
        """Return displacements and forces of the sliders."""
        pulls, _ = self.tensions()
        noise, found = self.rng.normal(size=4), dict[str, float]()
        for i in range(2):
            way = float(np.tanh(self.rates[i] / 1e-4))
            rub = self.slider[i] * (0.085 + 0.038 * pulls[i])
            found[f"x{i + 1}"] = float(self.positions[i]) + 5e-6 * noise[i]
            found[f"u{i + 1}"] = pulls[i] + way * rub + 0.3 * noise[2 + i]
        return found


class Bowden:
    """A finger whose motor pulls one cable through a Bowden sheath, against an extension spring."""

    def __init__(self, seed: int) -> None:
        self.rig = with_servos(hands_plants.bowden_rig())
        rng = self.rng = np.random.default_rng([seed, 92])
        self.friction = 0.12 * (1 + 0.2 * rng.uniform(-1, 1))
        self.cable, self.angles, self.positions = (
            Cable(STIFFNESS, self.friction, 3.0),
            np.zeros(1),
            np.array([0.2]),
        )
        self.rate, self.waiting = 0.0, 0
        for _ in range(3):
            self.solve()

    def solve(self) -> None:
        """Let finger and cable come to rest."""
        drive = SPOOL * float(self.positions[0])
        self.angles = np.array([turned(self.cable, drive, float(self.angles[0]), 0.0, 0.002)])
        self.cable.settle(drive, SLACK + ARM * float(self.angles[0]))

    def move(self, positions: Floats) -> None:
        """Turn the motor; the cable is solved in every fifth part."""
        self.rate = float(positions[0] - self.positions[0]) * PARTS / PERIOD
        self.positions, self.waiting = positions, self.waiting + 1
        if self.waiting % 5 == 0:
            self.solve()

    def read(self) -> dict[str, float]:
        """Return the motor's angle and torque."""
        tension, _ = self.cable.tensions(
            SPOOL * float(self.positions[0]), SLACK + ARM * float(self.angles[0])
        )
        motor = tension * SPOOL + 0.006 * np.tanh(self.rate / 0.02) + 0.002 * self.rate
        motor += 0.003 * cos(7 * hands_plants.GEAR * float(self.positions[0]) + 0.6)
        step = 2 * pi / (hands_plants.COUNTS * hands_plants.GEAR)
        noise = hands_plants.TORQUE_CONSTANT * hands_plants.GEAR * 0.003 * self.rng.normal()
        return {"motor": step * round(float(self.positions[0]) / step), "current": motor + noise}


class Chain:
    """A chain of joints in MuJoCo; its drives are held stiffly at their places."""

    def __init__(self, name: str, seed: int) -> None:
        self.rig = with_servos(load_rig(name))
        of = self.of = chain_plants.PLANTS[chain_plants.SHIPPED[name][0]]
        rng = self.rng = np.random.default_rng([seed, 94])
        truth = self.truth = chain_plants.draw_truth(of, rng)
        self.model = chain_plants.build_model(of, truth.springs)
        self.data, self.joints = mujoco.MjData(self.model), len(of.joints)
        self.winding = np.array(of.drives.winding)
        self.stretching = np.hstack([-truth.arms, self.winding])
        self.slack = np.array(of.pretensions) / truth.stiffness
        factors = np.append(truth.joint_friction, truth.drive_friction)
        constants = [joint.friction_constant for joint in of.joints]
        self.constant = factors * np.append(
            constants, [of.drives.friction_constant] * self.winding.shape[1]
        )
        per_joint = np.array([joint.friction_radius for joint in of.joints]) * (truth.arms != 0)
        share = of.drives.friction_share * np.abs(self.winding)
        self.per_tension = factors[:, np.newaxis] * np.hstack([per_joint, share]).T
        self.gains = (3e5, 120.0) if of.drives.kind == "slider" else (60.0, 0.03)
        self.start = np.radians([joint.init_degrees for joint in of.joints])
        self.data.qpos[: self.joints] = self.start
        wound = (
            self.start @ np.array(of.arms).T + (0.0 if any(of.pretensions) else 4.0) / of.stiffness
        )
        self.positions, self.efforts = (
            wound @ np.linalg.pinv(self.winding).T,
            np.zeros(self.winding.shape[1]),
        )
        self.data.qpos[self.joints :] = self.positions
        for _ in range(300):
            self.move(self.positions)

    @property
    def angles(self) -> Floats:
        """The joints' angles."""
        return np.array(self.data.qpos[: self.joints])

    def move(self, positions: Floats) -> None:
        """Draw the drives to places within one part of a sample, in steps of MuJoCo's."""
        steps, before, n, data = (
            round(PERIOD / PARTS / chain_plants.STEP),
            self.positions,
            self.joints,
            self.data,
        )
        for k in range(1, steps + 1):
            goal = before + (positions - before) * k / steps
            tensions = self.truth.stiffness * np.maximum(
                self.stretching @ data.qpos + self.slack, 0.0
            )
            self.efforts = self.gains[0] * (goal - data.qpos[n:]) - self.gains[1] * data.qvel[n:]
            data.qfrc_applied[:] = -self.stretching.T @ tensions
            data.qfrc_applied[n:] += self.efforts
            self.model.dof_frictionloss[:] = self.constant + self.per_tension @ tensions
            mujoco.mj_step(self.model, data)
        self.positions = positions

    def read(self) -> dict[str, float]:
        """Return the drives' places and efforts."""
        motor, drives = self.of.drives.kind == "motor", self.data.qpos[self.joints :]
        count = COUNT
        noise = self.rng.normal(size=(2, len(drives)))
        positions = count * np.round(drives / count) if motor else drives + 5e-6 * noise[0]
        efforts = self.efforts + (1.2e-3 if motor else 0.2) * noise[1]
        by_drive = dict(zip([drive.name for drive in self.rig.drives], range(len(drives))))
        kinds = {"position": positions, "force": efforts}
        proximal = [sensor for sensor in self.rig.sensors if sensor.measures in kinds]
        return {
            sensor.name: float(kinds[sensor.measures][by_drive[sensor.of]]) for sensor in proximal
        }


PLANTS = {
    "paper": Disk,
    "Bowden sheath": Bowden,
    "ropes": Ropes,
    **{name: (lambda seed, name=name: Chain(name, seed)) for name in chain_plants.SHIPPED},
}
"""Each takes a seed."""

"""What every part of the filter asks: the rig's equations, the sensors that are read, the guards,
and a sample's values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.tuning import Robustness
from distal.estimators.read_channels import Channels, sensor_for
from distal.expressions import Scalar, Vector, VectorNode
from distal.model import RESOLUTION, Mechanism, joint_frequency
from distal.rig import Sensor, contact_shape, drive_travel, gain_of

DERIVED = "filter."
"""Begins the names of the filter's inputs that are no parameters of the equations."""

MOST_TRAVELS = 20.0
"""A drive is never this many times its travel away from the middle of it."""


FOLLOWS = 2.0
"""A joint with so many radians of its own oscillation in one interval follows a jump within it; a
quarter turn is π/2.
"""

SETTLES = 30.0
"""With so many radians of it in one interval a joint's own oscillation is over: following it would
take 50 sub-steps.
"""

LONGEST_SUBSTEP = 2.5e-3
"""Longest sub-step of the joints alone [s]: their own modes are slow (docs/results/numerics.md)."""

CHAIN_RESOLUTION = 1.5
"""The same as `RESOLUTION` for chains: no sensor sees their fastest mode
(docs/explanation/numerics.md).
"""

MOST_JOINT_SUBSTEPS = 50
"""More sub-steps than this would cost more than they bring: a stiffer joint follows its tendons."""

SETTLING_SUBSTEPS = 8
"""Where the joints come to rest within an interval, they do so at so many positions of the drives
along it.
"""


@dataclass(frozen=True)
class FilterContext:
    """A rig as the filter reads it: its equations, the sensors that are read, and the guards."""

    mechanism: Mechanism
    channels: Channels
    robustness: Robustness

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.mechanism.n_joints

    @property
    def n_drives(self) -> int:
        """Number of drives."""
        return self.mechanism.n_drives

    @property
    def width(self) -> int:
        """Numbers in a sample x = (dt, values, mask)."""
        return 1 + 2 * len(self.channels.names)

    @cached_property
    def touchable(self) -> tuple[int, ...]:
        """The joints on which a torque may act that the rig does not declare, by their indices."""
        if not self.robustness.opens_torques:
            return ()
        joints = enumerate(self.mechanism.rig.joints)
        return tuple(
            j for j, joint in joints if joint.touch != "never" and joint.external_torque.std == 0.0
        )

    def moved_by(self, joint: int) -> dict[int, tuple[str, str]]:
        """Return drive → the names of r_d/r_j at a joint that it moves, and of the joint's share of
        that motion.
        """
        name = self.mechanism.rig.joints[joint].name
        return {
            drive: (f"drives.{drive}.ratio.{name}", f"drives.{drive}.share.{name}")
            for drive in self.ratios(joint)
        }

    def ratios(self, joint: int) -> dict[int, tuple[float, float]]:
        """Return drive → r_d/r_j at a joint that it moves, and the joint's share of that motion.

        Of all motions of the joints that would follow the drive, the smallest has the shares r_j²/Σ
        r².
        """
        rig = self.mechanism.rig
        found = dict[int, tuple[float, float]]()
        name = rig.joints[joint].name
        for i, drive in enumerate(rig.drives):
            tendon = next(
                (t for t in rig.tendons if t.drive == drive.name and name in t.joints), None
            )
            arms = {} if tendon is None else tendon.arms()
            if arms.get(name, 0.0) != 0.0:
                lever = drive.radius.value if drive.kind == "capstan" else 1.0
                share = (
                    arms[name] ** 2 / sum(arm**2 for arm in arms.values()) if len(arms) > 1 else 1.0
                )
                found[i] = lever / arms[name], share
        return found

    def by_torque(self, joint: int, sensor: Sensor) -> float:
        """Return by how much a force or tension changes for a torque on one joint, drives at rest
        [1/m, or 1]: r_d/r_j times the joint's share of the drive's motion; of a tension 1/r_j.
        """
        rig = self.mechanism.rig
        ratios = self.ratios(joint)
        of = sensor.of
        if sensor.measures == "tension":
            tendon = next(tendon for tendon in rig.tendons if tendon.name == sensor.of)
            of = tendon.drive
            if rig.joints[joint].name not in tendon.joints:
                return 0.0
        at = rig.drive_names.index(of)
        if at not in ratios:
            return 0.0
        ratio, share = ratios[at]
        drive = rig.drives[at]
        lever = drive.radius.value if drive.kind == "capstan" else 1.0
        return ratio * share / (lever if sensor.measures == "tension" else 1.0)

    def forces_by_torque(self, joint: int) -> dict[str, str]:
        """Return force or tension → the name of its change by a torque on a joint that it moves
        with.
        """
        forces = (*self.channels.forces, *self.channels.tensions)
        name = self.mechanism.rig.joints[joint].name
        return {
            sensor.name: f"{self.path(sensor)}.by_torque.{name}"
            for sensor in forces
            if self.by_torque(joint, sensor) != 0.0
        }

    def by_contact(self, joint: int) -> dict[str, float]:
        """Return force or tension → by how much it changes for a torque on a joint and those that
        contacts make with it, √(a_τᵀ C_τ a_τ) over the joint's own √C_τ, with a_τ of `by_torque`;
        where it changes at all.
        """
        shape = self.contact_shape
        changes = dict[str, float]()
        for sensor in (*self.channels.forces, *self.channels.tensions):
            alone = np.array([self.by_torque(i, sensor) for i in range(self.n_joints)])
            if shape[joint] @ alone != 0.0:
                square = alone @ shape @ alone / shape[joint, joint]
                changes[sensor.name] = float(np.sqrt(square))
            elif alone[joint] != 0.0:
                changes[sensor.name] = float(np.linalg.norm(alone))
        return changes

    @cached_property
    def contact_shape(self) -> Floats:
        """The covariance of the torques that contacts make on the joints that may be touched, zero
        for others, (n_joints, n_joints) [1].
        """
        may = np.zeros(self.n_joints)
        may[list(self.touchable)] = 1.0
        return contact_shape(self.mechanism.rig) * np.outer(may, may)

    @property
    def contact_structure(self) -> tuple[object, ...]:
        """What a kernel depends on of what contacts do."""
        loaded = (self.contact_shape != 0.0).tolist()
        return self.touchable, loaded, [list(self.by_contact(joint)) for joint in self.touchable]

    def loaded_with(self, joint: int, other: int) -> str:
        """Return the name of an entry of `contact_shape`."""
        return f"joints.{joint}.loaded_with.{self.mechanism.rig.joints[other].name}"

    @cached_property
    def frequency(self) -> float:
        """The joints' largest natural frequency [rad/s]."""
        return joint_frequency(self.mechanism)

    @cached_property
    def joints_follow(self) -> bool:
        """Whether a joint follows a jump of its drive within one interval: its own frequency times
        that is large.
        """
        return self.frequency * self.channels.interval > FOLLOWS

    @cached_property
    def joints_settle(self) -> bool:
        """Whether the joints come to rest within one interval: it is long against their own
        oscillation.
        """
        return self.frequency * self.channels.interval > SETTLES

    def substeps(self, resolution: float | None) -> int:
        """Return the sub-steps of the joints in one interval.

        A `resolution` is the largest product of sub-step and a joint's own frequency; None for
        `RESOLUTION`, of a chain `CHAIN_RESOLUTION`.
        """
        mechanism = self.mechanism
        if resolution is None:
            resolution = (
                RESOLUTION
                if mechanism.chain is None or mechanism.n_joints == 1
                else CHAIN_RESOLUTION
            )
        longest = min(LONGEST_SUBSTEP, resolution / max(self.frequency, 1e-12))
        needed = min(
            max(1, int(np.ceil(self.channels.interval / longest - 1e-9))), MOST_JOINT_SUBSTEPS
        )
        return SETTLING_SUBSTEPS if self.joints_settle else needed

    def position_sensor(self, drive: int) -> Sensor | None:
        """Return the sensor of a drive's position, or None."""
        return sensor_for(self.channels.positions, self.mechanism.rig.drives[drive].name)

    def force_sensor(self, drive: int) -> Sensor | None:
        """Return the sensor of a drive's force or torque, or None."""
        return sensor_for(self.channels.forces, self.mechanism.rig.drives[drive].name)

    def value(self, x: Vector, sensor: Sensor) -> Scalar:
        """Return what a sensor reads in a sample x, without its known offset and gain; what 0
        stands for where missing.
        """
        return self.corrected(sensor, x[1 + self.channels.names.index(sensor.name)])

    def reading(self, x: VectorNode, name: str) -> VectorNode:
        """Return what the sensor of that name reads in a sample x."""
        return x[1 + self.channels.names.index(name)]

    def corrected(self, sensor: Sensor, reading: Scalar) -> Scalar:
        """Return a reading without the sensor's known offset and gain."""
        path = self.path(sensor)
        offset = reading - self.number(f"{path}.bias")
        return offset / self.number(f"{path}.gain") if has_gain(sensor) else offset

    def mask(self, x: Vector, sensor: Sensor) -> Scalar:
        """Return the mask of a sensor's value in a sample x, see `distal.kernels.mask`; a wild
        value is missing.
        """
        k = self.channels.names.index(sensor.name)
        width = len(self.channels.names)
        return x[1 + width + k] * self.credible(sensor, x[1 + k])

    def credible(self, sensor: Sensor, reading: Scalar) -> Scalar:
        """Return 1 where a drive could be where its sensor says, 0 where the `reading` is wild.

        Geometry is not defined at a position `MOST_TRAVELS` times the travel away, so that no later
        guard would stop it. What measures no position is always credible.
        """
        if sensor.measures != "position" or not self.robustness.asks_positions:
            return 1
        path = self.path(sensor)
        return ca.fabs(reading - self.number(f"{path}.centre")) <= self.number(f"{path}.farthest")

    def possible_positions(self, sensor: Sensor) -> tuple[float, float]:
        """Return the middle of what a position sensor can read, and how far away it can:
        `MOST_TRAVELS` of its drive.
        """
        drives = self.mechanism.rig.drive_names
        low, high = drive_travel(self.mechanism.rig, drives.index(sensor.of))
        centre = sensor.bias.value + 0.5 * (low + high)
        away = MOST_TRAVELS * (high - low + sensor.noise + sensor.bias.total_std) + sensor.linearity
        return centre, away

    def number(self, path: str) -> Scalar:
        """Return a number of the description, or one that follows from it, see `filter_numbers`."""
        return self.mechanism.parameters[self._name(path)]

    def parameters(self, p: VectorNode, paths: Sequence[str]) -> VectorNode:
        """Return such numbers of the filter's inputs `p`."""
        return self.mechanism.parameters.of(p, [self._name(path) for path in paths])

    def _name(self, path: str) -> str:
        return path if path in self.mechanism.parameters.inputs else f"{DERIVED}{path}"

    def noise(self, sensor: Sensor) -> Scalar:
        """Return the variance of a sensor's random error, noise² + resolution²/12."""
        path = self.path(sensor)
        return self.number(f"{path}.noise") ** 2 + self.number(f"{path}.rounding")

    def bias_std(self, sensor: Sensor) -> float:
        """Return how unsure a sensor's offset is: nothing where the offset is an input of the
        filter (a fit).
        """
        return (
            0.0
            if f"{self.path(sensor)}.bias" in self.mechanism.parameters.inputs
            else float(sensor.bias.filter_std)
        )

    def gain_std(self, sensor: Sensor) -> float:
        """Return how unsure a sensor's gain is, as a share of it: nothing where it is an input of
        the filter (a fit).
        """
        gain = gain_of(sensor)
        is_input = f"{self.path(sensor)}.gain" in self.mechanism.parameters.inputs
        return 0.0 if is_input else float(gain.filter_std / gain.value)

    def path(self, sensor: Sensor) -> str:
        """Return the path of a sensor in the description."""
        return self.path_of(sensor.name)

    def path_of(self, name: str) -> str:
        """Return the path of the sensor of that name."""
        return f"sensors.{self.mechanism.rig.sensor_names.index(name)}"

    def unmodelled(self, joint: int) -> Scalar:
        """Return the random torque of a joint that the model lacks, as the std of ω that it makes
        in 1 s [rad/s].
        """
        return self.robustness.unmodelled * self.number(f"joints.{joint}.unmodelled")

    def declares_friction(self, drive: int) -> bool:
        """Return whether the rig declares friction at a drive: more than
        `Robustness.declared_friction` at its load.
        """
        part = self.mechanism.rig.drives[drive]
        lever = part.radius.value if part.kind == "capstan" else 1.0
        tendons = [t for t in self.mechanism.rig.tendons if t.drive == part.name]
        load = max(
            abs(part.nominal_force.value) / lever, sum(t.pretension.value for t in tendons), 1.0
        )
        constant = part.friction.constant
        growing = part.friction.load
        limit = (constant.value + constant.std) / lever + (growing.value + growing.std) * load
        for tendon in tendons:
            if tendon.path is not None and tendon.path.nodes == 0:
                rubs = tendon.path.friction
                limit += load * float(np.expm1((rubs.value + rubs.std) * tendon.path.wrap.value))
        return bool(limit >= self.robustness.declared_friction)


def has_gain(sensor: Sensor) -> bool:
    """Return whether a sensor has a gain: those of forces and torques do."""
    return "gain" in type(sensor).model_fields

"""A rig as all steps of the filter see it: its equations, the sensors that are read, the guards,
and the values of a sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.guard_settings import Robustness
from distal.estimators.estimator_protocol import Channels, sensor_for
from distal.expressions import Scalar, Vector, VectorNode
from distal.model import RESOLUTION, Mechanism, joint_frequency
from distal.rig import Rig, Sensor, contact_shape, drive_travel, gain_of

DERIVED = "filter."
"""Beginning of the names of the filter's inputs that are no parameters of the equations."""

MOST_TRAVELS = 20.0
"""Largest distance of a drive from the middle of its travel, in travels [1]. Source: judgement."""


SETTLES = 30.0
"""Phase of a joint's own oscillation in one interval, above which the oscillation is over within it
[rad]: to follow it would take 50 sub-steps. Source: judgement.
"""

LONGEST_SUBSTEP = 2.5e-3
"""Longest sub-step of the joints alone [s]: their own modes are slow. Source: benchmark
(docs/results/numerics.md).
"""

CHAIN_RESOLUTION = 1.5
"""Largest product of sub-step and natural frequency on a chain, in place of `RESOLUTION` [1]: no
sensor sees its fastest mode. Source: benchmark (docs/explanation/numerics.md).
"""

MOST_JOINT_SUBSTEPS = 50
"""Largest number of sub-steps in an interval [1]: more would cost more than they bring, since a
stiffer joint follows its tendons. Source: judgement.
"""

SETTLING_SUBSTEPS = 8
"""Number of sub-steps in an interval within which the joints come to rest [1]: they rest at as many
positions of the drives along it. Source: judgement.
"""


@dataclass(frozen=True)
class FilterContext:
    """A rig as the filter reads it.

    Args:
        mechanism: its equations.
        channels: the sensors that are read.
    """

    mechanism: Mechanism
    channels: Channels
    robustness: Robustness

    @property
    def rig(self) -> Rig:
        """The description."""
        return self.mechanism.rig

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
        """Length of a sample x = (dt, values, mask)."""
        return self.channels.row.size

    @property
    def forces(self) -> tuple[Sensor, ...]:
        """The sensors of drives' forces, then those of tendons' tensions."""
        return (*self.channels.forces, *self.channels.tensions)

    def lever(self, drive: int) -> float:
        """Return the tendons' displacement per displacement of a drive: the radius of a capstan
        [m], 1 for a slider.
        """
        part = self.rig.drives[drive]
        return part.radius.value if part.kind == "capstan" else 1.0

    @cached_property
    def touchable(self) -> tuple[int, ...]:
        """Indices of the joints on which a torque may act that the rig does not declare."""
        if not self.robustness.opens_torques:
            return ()
        joints = enumerate(self.rig.joints)
        return tuple(
            j for j, joint in joints if joint.touch != "never" and joint.external_torque.std == 0.0
        )

    def moved_by(self, joint: int) -> dict[int, tuple[str, str]]:
        """Return drive → names of the ratio r_d/r_j and of the joint's share, see `ratios`, for
        each drive that moves a joint.
        """
        name = self.rig.joints[joint].name
        return {
            drive: (f"drives.{drive}.ratio.{name}", f"drives.{drive}.share.{name}")
            for drive in self.ratios(joint)
        }

    def ratios(self, joint: int) -> dict[int, tuple[float, float]]:
        """Return drive → the ratio r_d/r_j and the joint's share of the drive's motion, for each
        drive that moves a joint.

        Of all motions of the joints that would follow the drive, the smallest has the shares r_j²/Σ
        r².
        """
        rig = self.rig
        found = dict[int, tuple[float, float]]()
        name = rig.joints[joint].name
        for i, drive in enumerate(rig.drives):
            tendons = (tendon for tendon in rig.tendons_of(drive.name) if name in tendon.joints)
            arms = next((tendon.arms() for tendon in tendons), dict[str, float]())
            if arms.get(name, 0.0) != 0.0:
                share = arms[name] ** 2 / sum(arm**2 for arm in arms.values())
                found[i] = self.lever(i) / arms[name], share
        return found

    def by_torque(self, joint: int, sensor: Sensor) -> float:
        """Return the change of a force or tension by a torque on one joint, with drives at rest
        [1/m, or 1].

        It is r_d/r_j times the joint's share of the drive's motion; of a tension 1/r_j times that
        share.
        """
        rig = self.rig
        if sensor.measures != "tension":
            drive = rig.drive_names.index(sensor.of)
            lever = 1.0
        else:
            tendon = rig.tendons[rig.tendon_names.index(sensor.of)]
            drive = rig.drive_names.index(tendon.drive)
            lever = self.lever(drive)
            if rig.joints[joint].name not in tendon.joints:
                return 0.0
        ratio, share = self.ratios(joint).get(drive, (0.0, 0.0))
        return ratio * share / lever

    def by_contact(self, joint: int) -> dict[str, float]:
        """Return force or tension → its change by a contact's torque on a joint, with the torques
        on other joints that come with it.

        The change is √(a_τᵀ C_τ a_τ) over the joint's own √C_τ, with a_τ of `by_torque` and C_τ the
        `contact_shape`. Where the joint's row of C_τ times a_τ is 0, it is the root of the sum of
        a_τ². Forces that do not change are left out.
        """
        shape = self.contact_shape
        changes = dict[str, float]()
        for sensor in self.forces:
            alone = np.array([self.by_torque(i, sensor) for i in range(self.n_joints)])
            if shape[joint] @ alone != 0.0:
                square = alone @ shape @ alone / shape[joint, joint]
                changes[sensor.name] = float(np.sqrt(square))
            elif alone[joint] != 0.0:
                changes[sensor.name] = float(np.linalg.norm(alone))
        return changes

    @cached_property
    def contact_shape(self) -> Floats:
        """Covariance of the torques that contacts make on the joints that may be touched, zero for
        others, (n_joints, n_joints) [1].
        """
        may = np.zeros(self.n_joints)
        may[list(self.touchable)] = 1.0
        return contact_shape(self.rig) * np.outer(may, may)

    @property
    def contact_structure(self) -> tuple[object, ...]:
        """What the structure of a kernel depends on in contacts."""
        loaded = (self.contact_shape != 0.0).tolist()
        return self.touchable, loaded, [list(self.by_contact(joint)) for joint in self.touchable]

    def loaded_with(self, joint: int, other: int) -> str:
        """Return the name of the correlation of the torques that contacts make on two joints."""
        return f"joints.{joint}.loaded_with.{self.rig.joints[other].name}"

    @cached_property
    def frequency(self) -> float:
        """The largest natural frequency of the joints [rad/s]."""
        return joint_frequency(self.mechanism)

    @cached_property
    def jumps(self) -> list[tuple[float, float]]:
        """The stiffness of each drive with the joints held, and the least share of it that its
        force shows of a jump within one interval [1].

        With the stiffness K of the tendons in the coordinates of drives d and joints q, joints that
        follow by u = K_qq⁻¹ K_qd leave K_dd − K_dq u. They do so with ω² = K_dq u/uᵀ M u
        (Rayleigh's quotient); what they have not followed yet of the rest is cos(ω T).
        """
        mechanism = self.mechanism
        rig = mechanism.rig
        n = self.n_joints
        arms = np.zeros((len(rig.tendons), n + self.n_drives))
        for row, tendon in zip(arms, rig.tendons):
            drive = rig.drive_names.index(tendon.drive)
            for name, arm in tendon.arms().items():
                row[rig.joint_names.index(name)] = -arm
            wound = rig.drives[drive].kind == "capstan" or tendon.side is not None
            row[n + drive] = self.lever(drive) * (tendon.winding if wound else 1)
        stiffness = (arms.T * [tendon.stiffness.value for tendon in rig.tendons]) @ arms
        across = stiffness[:n, n:]
        held = np.diag(stiffness)[n:]
        motion = np.linalg.pinv(stiffness[:n, :n]) @ across
        followed = np.sum(across * motion, axis=0)
        symbols = mechanism.parameters.symbols
        masses = mechanism.mass_matrix(ca.SX.zeros(mechanism.n_bodies))
        mass = ca.Function("mass", [symbols], [masses])(mechanism.parameters.values).full()
        inertia = np.sum(motion * (mass @ motion), axis=0)
        frequencies = np.sqrt(followed / np.maximum(inertia, 1e-300))
        turned = np.minimum(frequencies * self.channels.interval, np.pi / 2)
        shown = 1.0 - followed / np.maximum(held, 1e-300) * (1.0 - np.cos(turned))
        return list(zip(held.tolist(), np.clip(shown, 0.0, 1.0).tolist()))

    @cached_property
    def joints_settle(self) -> bool:
        """Whether the joints come to rest within one interval: `frequency` times the interval is
        above `SETTLES`.
        """
        return self.frequency * self.channels.interval > SETTLES

    def substeps(self, resolution: float | None) -> int:
        """Return the number of sub-steps of the joints in one interval.

        The `resolution` is the largest product of sub-step and a joint's own frequency; None stands
        for `RESOLUTION`, on a chain `CHAIN_RESOLUTION`.
        """
        mechanism = self.mechanism
        if resolution is None:
            resolution = RESOLUTION if mechanism.chain is None else CHAIN_RESOLUTION
        longest = min(LONGEST_SUBSTEP, resolution / max(self.frequency, 1e-12))
        needed = min(
            max(1, int(np.ceil(self.channels.interval / longest - 1e-9))), MOST_JOINT_SUBSTEPS
        )
        return SETTLING_SUBSTEPS if self.joints_settle else needed

    def position_sensor(self, drive: int) -> Sensor | None:
        """Return the sensor of a drive's position, or None."""
        return sensor_for(self.channels.positions, self.rig.drives[drive].name)

    def force_sensor(self, drive: int) -> Sensor | None:
        """Return the sensor of a drive's force or torque, or None."""
        return sensor_for(self.channels.forces, self.rig.drives[drive].name)

    def value(self, x: Vector, sensor: Sensor) -> Scalar:
        """Return the reading of a sensor in a sample x, less its known offset and divided by its
        known gain; meaningless where it is missing.
        """
        return self.corrected(sensor, x[1 + self.channels.names.index(sensor.name)])

    def corrected(self, sensor: Sensor, reading: Scalar) -> Scalar:
        """Return a reading less the sensor's known offset, divided by its known gain."""
        path = self.path(sensor)
        offset = reading - self.number(f"{path}.bias")
        return offset / self.number(f"{path}.gain") if has_gain(sensor) else offset

    def mask(self, x: Vector, sensor: Sensor) -> Scalar:
        """Return the mask of a sensor's value in a sample x, see `distal.kernels.layout`; a value
        that is not `credible` is missing.
        """
        k = self.channels.names.index(sensor.name)
        _, values, mask = self.channels.row.parts(x).values()
        return mask[k] * self.credible(sensor, values[k])

    def credible(self, sensor: Sensor, reading: Scalar) -> Scalar:
        """Return 1 where a drive could be where its sensor reads, else 0.

        It could not be more than `MOST_TRAVELS` times its travel away, where the tendons' geometry
        is not defined, so that no later guard would stop the `reading`. A sensor of anything but a
        position is always credible.
        """
        if sensor.measures != "position" or not self.robustness.asks_positions:
            return 1
        path = self.path(sensor)
        return ca.fabs(reading - self.number(f"{path}.middle")) <= self.number(f"{path}.farthest")

    def possible_positions(self, sensor: Sensor) -> tuple[float, float]:
        """Return the middle of what a position sensor can read, and the largest distance from it:
        `MOST_TRAVELS` times its drive's travel and the sensor's errors.
        """
        drives = self.rig.drive_names
        low, high = drive_travel(self.rig, drives.index(sensor.of))
        centre = sensor.bias.value + 0.5 * (low + high)
        away = MOST_TRAVELS * (high - low + sensor.noise + sensor.bias.total_std) + sensor.linearity
        return centre, away

    def number(self, path: str) -> Scalar:
        """Return a parameter of the description by its path, or a number that follows from it, see
        `filter_inputs`.
        """
        return self.mechanism.parameters[self._name(path)]

    def parameters(self, p: VectorNode, paths: Sequence[str]) -> VectorNode:
        """Return several such values, see `number`, from the filter's inputs `p`."""
        return self.mechanism.parameters.of(p, [self._name(path) for path in paths])

    def _name(self, path: str) -> str:
        return path if path in self.mechanism.parameters.inputs else f"{DERIVED}{path}"

    def noise(self, sensor: Sensor) -> Scalar:
        """Return the variance of a sensor's random error, noise² + resolution²/12."""
        path = self.path(sensor)
        return self.number(f"{path}.noise") ** 2 + self.number(f"{path}.rounding")

    def bias_std(self, sensor: Sensor) -> float:
        """Return the std of a sensor's offset; 0 where the offset is an input of the filter (a
        fit).
        """
        return (
            0.0
            if f"{self.path(sensor)}.bias" in self.mechanism.parameters.inputs
            else float(sensor.bias.filter_std)
        )

    def gain_std(self, sensor: Sensor) -> float:
        """Return the std of a sensor's gain, as a share of the gain; 0 where the gain is an input
        of the filter (a fit).
        """
        gain = gain_of(sensor)
        is_input = f"{self.path(sensor)}.gain" in self.mechanism.parameters.inputs
        return 0.0 if is_input else float(gain.filter_std / gain.value)

    def path(self, sensor: Sensor) -> str:
        """Return the path of a sensor in the description."""
        return f"sensors.{self.rig.sensor_names.index(sensor.name)}"

    def unmodelled(self, joint: int) -> Scalar:
        """Return the random torque on a joint that the model lacks, as the std of ω that it makes
        in 1 s [rad/s].
        """
        return self.robustness.unmodelled * self.number(f"joints.{joint}.unmodelled")

    def declares_friction(self, drive: int) -> bool:
        """Return whether the rig declares friction at a drive: at least
        `Robustness.declared_friction` at its load.
        """
        part = self.rig.drives[drive]
        lever = self.lever(drive)
        tendons = self.rig.tendons_of(part.name)
        load = max(abs(part.nominal_force.value) / lever, sum(t.home_tension for t in tendons), 1.0)
        constant = part.friction.constant
        growing = part.friction.load
        limit = (constant.value + constant.std) / lever + (growing.value + growing.std) * load
        for tendon in tendons:
            if tendon.path is not None and tendon.path.nodes == 0:
                rubs = tendon.path.friction
                limit += load * float(np.expm1((rubs.value + rubs.std) * tendon.path.wrap.value))
        return bool(limit >= self.robustness.declared_friction)


def has_gain(sensor: Sensor) -> bool:
    """Return whether a sensor has a gain: sensors of forces and torques do."""
    return "gain" in type(sensor).model_fields

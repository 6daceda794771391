"""What is unknown of a drive: its position where no sensor measures it, friction that the rig does
not declare, and the effort that its transmission passes on, with the error of the play operator.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import Fading, OfDrive, Prior, State, ZeroMean
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Hysteresis, Sensor, SliderHysteresis, drive_travel
from distal.sensor_errors import variance

POSITION_WALK = 1.0
"""Random walk of a drive's position that nothing measures, in its travel [1/√s]: the drive may
cross it within a second. Source: judgement.
"""


@dataclass(frozen=True)
class UnmeasuredPosition(OfDrive):
    """The position s of a drive without a position sensor: anywhere on its travel at first; then it
    walks.
    """

    quantity: ClassVar[str] = "position"
    kind: ClassVar[StateKind] = StateKind.POSITION

    @cached_property
    def _travel(self) -> tuple[float, float]:
        return drive_travel(self.context.mechanism.rig, self.drive)

    @property
    def means(self) -> Floats:
        """Prior mean: the middle of the travel [m, rad]."""
        return np.array([sum(self._travel) / 2])

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: that of a uniform distribution over the travel [m, rad]."""
        low, high = self._travel
        return np.array([(high - low) / np.sqrt(12.0)])

    @property
    def walk(self) -> float:
        """Random walk: `POSITION_WALK` travels per √s."""
        low, high = self._travel
        return (high - low) * POSITION_WALK

    def position(self, drive: int, values: Vector) -> Scalar | None:
        """Return s [m, rad] if it is that of this drive, else None."""
        return values[0] if drive == self.drive else None


def unmeasured_positions(context: FilterContext) -> list[State]:
    """Return a block for each drive without a position sensor."""
    return [
        UnmeasuredPosition(context, i)
        for i in range(context.n_drives)
        if context.position_sensor(i) is None
    ]


@dataclass(frozen=True)
class UnknownFriction(OfDrive, ZeroMean):
    """An addition to the friction limit of a drive for which the rig declares no friction.

    Its size follows the noise σ of the drive's force sensor. It is not smoothed: friction at one
    time tells little of another time (docs/explanation/adaptive-guards.md).
    """

    quantity: ClassVar[str] = "friction"
    kind: ClassVar[StateKind] = StateKind.FRICTION
    smoothed: ClassVar[bool] = False

    sensor: Sensor

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: `Robustness.unknown_friction` σ [N, N m]."""
        return np.array(
            [self.context.robustness.unknown_friction * float(np.sqrt(variance(self.sensor)))]
        )

    @property
    def walk(self) -> float:
        """Random walk: `Robustness.unknown_friction_walk` σ per √s."""
        return self.context.robustness.unknown_friction_walk * float(np.sqrt(variance(self.sensor)))

    def friction(self, drive: int, values: Vector) -> Scalar:
        """Return the addition [N, N m] if it is that of this drive, else 0."""
        return values[0] if drive == self.drive else 0


def unknown_frictions(context: FilterContext) -> list[State]:
    """Return a block for each drive with a force sensor whose friction the rig does not declare."""
    blocks: list[State] = []
    for i, drive in enumerate(context.mechanism.rig.drives):
        sensor = context.force_sensor(i)
        looked_for = context.robustness.unknown_friction > 0.0 and drive.hysteresis is None
        if sensor is not None and looked_for and not context.declares_friction(i):
            blocks.append(UnknownFriction(context, i, sensor))
    return blocks


CALM = 8.0
"""Limit of a play over the noise of its smoothed effort, at least, (14) [1]. Source: judgement."""


@dataclass(frozen=True)
class Transmitted(OfDrive):
    """The effort z that a play operator passes on; `transmission_play.play` moves it."""

    quantity: ClassVar[str] = "transmitted"
    kind: ClassVar[StateKind] = StateKind.TRANSMITTED

    sensor: Sensor

    @property
    def means(self) -> Floats:
        """Prior mean: the nominal force [N, N m]; the first reading replaces it."""
        return np.array([self.context.mechanism.rig.drives[self.drive].nominal_force.value])

    @property
    def stds(self) -> Floats:
        """Prior standard deviation [N, N m]: anywhere within the limits h of the play, h/√3, and
        the sensor's noise.
        """
        return np.array(
            [float(np.hypot(self.limit / np.sqrt(3.0), np.sqrt(variance(self.sensor))))]
        )

    def prior(self) -> tuple[Prior | None, Prior | None]:
        """Return the prior standard deviation [N, N m] as an expression of the sensor's noise,
        which a fit may vary; None for the mean.
        """
        limit = self.context.number(self.limit_name)
        return None, ca.sqrt(limit**2 / 3.0 + self.context.noise(self.sensor))

    @property
    def limit_name(self) -> str:
        """Name of h among the filter's inputs."""
        return f"drives.{self.drive}.play_limit"

    @property
    def weight_name(self) -> str:
        """Name of the weight of a new reading among the filter's inputs, see `reading_weight`."""
        return f"drives.{self.drive}.reading_weight"

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield h, and the weight of a new reading of the drive's effort."""
        yield self.limit_name, self.limit
        yield self.weight_name, reading_weight(self.limit, variance(self.sensor))

    @cached_property
    def limit(self) -> float:
        """Limit h of the play [N, N m] at pre-tension, with the joints at their `initial`
        angles.
        """
        mechanism = self.context.mechanism
        tensions = ca.DM([tendon.pretension.value for tendon in mechanism.rig.tendons])
        angles = [joint.initial.value for joint in mechanism.rig.joints]
        limit = mechanism.hysteresis_limit(
            self.drive, ca.vertcat(*angles, ca.DM.zeros(mechanism.n_drives)), tensions
        )
        p = mechanism.parameters
        return float(ca.Function("limit", [p.symbols], [limit])(p.values))


@dataclass(frozen=True)
class TransmissionError(OfDrive, ZeroMean):
    """The part of a transmission's hysteresis that one play operator leaves out: considered, since
    the model has no state for it.
    """

    quantity: ClassVar[str] = "transmission_error"
    kind: ClassVar[StateKind] = StateKind.TRANSMISSION_ERROR
    considered: ClassVar[bool] = True

    hysteresis: Hysteresis | SliderHysteresis

    @property
    def stds(self) -> Floats:
        """Prior standard deviation: ``hysteresis.error`` [N, N m]."""
        return np.array([self.hysteresis.error])

    def prior(self) -> tuple[Prior | None, Prior | None]:
        """Return the std, which a fit may vary [N, N m]."""
        return None, self._number("error")

    def inputs(self) -> Iterator[tuple[str, float]]:
        """Yield std and correlation time of the error."""
        path = f"drives.{self.drive}.hysteresis"
        yield f"{path}.error", self.hysteresis.error
        yield f"{path}.error_time", self.hysteresis.error_time

    def _number(self, key: str) -> Scalar:
        return self.context.number(f"drives.{self.drive}.hysteresis.{key}")

    def fading(self, dt: Scalar) -> Fading:
        """Return e^{−dt/T} with T = ``hysteresis.error_time``, and the std after a long time [N, N
        m].
        """
        return Fading(ca.exp(-dt / self._number("error_time")), self._number("error"))

    def force(self, drive: int, values: Vector) -> Scalar:
        """Return minus the error [N, N m] if it is that of this drive, else 0: the transmitted
        effort lacks it.
        """
        return -values[0] if drive == self.drive else 0


def reading_weight(limit: float, noise: float) -> float:
    """Return the weight of a new reading of a drive's effort in its smoothed value: (14).

    It is 1 where the reading's variance `noise` is small against the square of the play's `limit`.
    """
    ratio = min((limit / CALM) ** 2 / noise, 1.0)
    return 2.0 * ratio / (1.0 + ratio)


def transmissions(context: FilterContext) -> list[State]:
    """Return the blocks of each drive with hysteresis and a force sensor."""
    blocks: list[State] = []
    for i, drive in enumerate(context.mechanism.rig.drives):
        sensor = context.force_sensor(i)
        if sensor is None or drive.hysteresis is None:
            continue
        blocks.append(Transmitted(context, i, sensor))
        if drive.hysteresis.error > 0.0:
            blocks.append(TransmissionError(context, i, drive.hysteresis))
    return blocks

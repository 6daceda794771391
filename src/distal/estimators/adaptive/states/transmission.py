"""The effort that a drive's transmission passes on where it has hysteresis, and the error of its
play operator.
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
from distal.rig import Hysteresis, Sensor, SliderHysteresis
from distal.sensor_errors import variance

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

"""What a drive's transmission passes on where it has hysteresis, and what its play leaves out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.context import FilterContext
from distal.estimators.adaptive.states.state import Fading, OfDrive, Prior, State, ZeroMean
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Hysteresis, Sensor, SliderHysteresis
from distal.sensor_errors import variance


@dataclass(frozen=True)
class Transmitted(OfDrive):
    """z, the effort that a play passes on; `play` moves it."""

    quantity: ClassVar[str] = "transmitted"
    kind: ClassVar[StateKind] = StateKind.TRANSMITTED

    sensor: Sensor

    @property
    def means(self) -> Floats:
        """The nominal force; the first reading takes its place [N, N m]."""
        return np.array([self.context.mechanism.rig.drives[self.drive].nominal_force.value])

    @property
    def stds(self) -> Floats:
        """Anywhere within the limits h of the play, h/√3, and the sensor's noise [N, N m]."""
        return np.array(
            [float(np.hypot(self.limit / np.sqrt(3.0), np.sqrt(variance(self.sensor))))]
        )

    def prior(self) -> tuple[Prior, Prior]:
        """Return the same with the sensor's noise as a fit varies it [N, N m]."""
        return self.means, ca.sqrt(self.limit**2 / 3.0 + self.context.noise(self.sensor))

    @cached_property
    def limit(self) -> float:
        """Limit h of the play [N, N m] at pre-tension, with the joints where they start."""
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
    """What one play leaves out of a transmission: considered, since no state of the model is behind
    it.
    """

    quantity: ClassVar[str] = "transmission_error"
    kind: ClassVar[StateKind] = StateKind.TRANSMISSION_ERROR
    considered: ClassVar[bool] = True

    hysteresis: Hysteresis | SliderHysteresis

    @property
    def stds(self) -> Floats:
        """``hysteresis.error`` [N, N m]."""
        return np.array([self.hysteresis.error])

    def prior(self) -> tuple[Prior, Prior]:
        """Return zero and the std, which a fit may vary [N, N m]."""
        return self.means, self._error

    @property
    def _error(self) -> Scalar:
        return self.context.number(f"drives.{self.drive}.hysteresis.error", float(self.stds[0]))

    def fading(self, dt: Scalar) -> Fading:
        """Return e^{−dt/T} with T = ``hysteresis.error_time``, and the std [N, N m]."""
        time = self.context.number(
            f"drives.{self.drive}.hysteresis.error_time", self.hysteresis.error_time
        )
        return Fading(ca.exp(-dt / time), self._error)

    def force(self, drive: int, numbers: Vector) -> Scalar:
        """Return minus the error where it is this drive's: what is transmitted lacks it [N, N
        m].
        """
        return -numbers[0] if drive == self.drive else 0


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

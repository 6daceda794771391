"""What a drive's transmission passes on where it has hysteresis, and what its play leaves out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.context import FilterContext
from distal.estimators.adaptive.states.state import Fading, Prior, State
from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar, Vector
from distal.rig import Hysteresis, Sensor, SliderHysteresis
from distal.sensors import variance


@dataclass(frozen=True)
class Transmitted(State):
    """z, the effort that a play passes on; `play` moves it.

    Args:
        context: the rig.
        drive: index of the drive.
        sensor: of its effort.
    """

    context: FilterContext
    drive: int
    sensor: Sensor

    @property
    def kind(self) -> StateKind:
        """What a play passes on."""
        return StateKind.TRANSMITTED

    @property
    def part(self) -> str:
        """The drive's name."""
        return self.context.mechanism.rig.drives[self.drive].name

    @property
    def names(self) -> tuple[str, ...]:
        """``transmitted_DRIVE``."""
        return (f"transmitted_{self.context.mechanism.rig.drives[self.drive].name}",)

    @property
    def means(self) -> Floats:
        """The nominal force; the first reading takes its place [N, N m]."""
        return np.array([self.context.mechanism.rig.drives[self.drive].nominal_force.value])

    @property
    def stds(self) -> Floats:
        """Anywhere within the limits h of the play, h/√3, and the sensor's noise [N, N m]."""
        return np.array([float(np.hypot(self.limit / np.sqrt(3.0), np.sqrt(variance(self.sensor))))])

    def prior(self) -> tuple[Prior, Prior]:
        """Return the same with the sensor's noise as a fit varies it [N, N m]."""
        return self.means, ca.sqrt(self.limit**2 / 3.0 + self.context.noise(self.sensor))

    @cached_property
    def limit(self) -> float:
        """Limit h of the play [N, N m] at pre-tension, with the joints where they start."""
        mechanism = self.context.mechanism
        tensions = ca.DM([tendon.pretension.value for tendon in mechanism.rig.tendons])
        angles = [joint.initial.value for joint in mechanism.rig.joints]
        limit = mechanism.hysteresis_limit(self.drive, ca.vertcat(*angles, ca.DM.zeros(mechanism.n_drives)), tensions)
        p = mechanism.parameters
        return float(ca.Function("limit", [p.symbols], [limit])(p.values))


@dataclass(frozen=True)
class TransmissionError(State):
    """What one play leaves out of a transmission: considered, since no state of the model is behind it.

    Args:
        context: the rig.
        drive: index of the drive.
        hysteresis: its description.
    """

    context: FilterContext
    drive: int
    hysteresis: Hysteresis | SliderHysteresis

    @property
    def kind(self) -> StateKind:
        """What a play leaves out."""
        return StateKind.TRANSMISSION_ERROR

    @property
    def part(self) -> str:
        """The drive's name."""
        return self.context.mechanism.rig.drives[self.drive].name

    @property
    def names(self) -> tuple[str, ...]:
        """``transmission_error_DRIVE``."""
        return (f"transmission_error_{self.context.mechanism.rig.drives[self.drive].name}",)

    @property
    def means(self) -> Floats:
        """None is expected [N, N m]."""
        return np.zeros(1)

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

    @property
    def considered(self) -> bool:
        """It is: its uncertainty counts, but it is never estimated."""
        return True

    def fading(self, dt: Scalar) -> Fading:
        """Return e^{−dt/T_i}, T_i being ``hysteresis.error_time``, and the std [N, N m].

        Args:
            dt: length of the interval [s].
        """
        path = f"drives.{self.drive}.hysteresis"
        time = self.context.number(f"{path}.error_time", self.hysteresis.error_time)
        return Fading(ca.exp(-dt / time), self._error)

    def force(self, drive: int, own: Vector) -> Scalar:
        """Return minus the error where it is this drive's: what is transmitted lacks it [N, N m].

        Args:
            own: the error.
        """
        return -own[0] if drive == self.drive else 0


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

"""What a drive's transmission passes on where it has hysteresis, and what its play leaves out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.estimators.adaptive.setup import Setup
from distal.estimators.adaptive.states.state import Fading, State
from distal.rig import Hysteresis, Sensor, SliderHysteresis
from distal.sensors import variance

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Transmitted(State):
    """z, the effort that a play passes on; `play` moves it.

    Args:
        setup: the rig.
        drive: index of the drive.
        sensor: of its effort.
    """

    setup: Setup
    drive: int
    sensor: Sensor

    @property
    def names(self) -> tuple[str, ...]:
        """``transmitted_DRIVE``."""
        return (f"transmitted_{self.setup.mechanism.rig.drives[self.drive].name}",)

    @property
    def means(self) -> Floats:
        """The nominal force; the first reading takes its place [N, N m]."""
        return np.array([self.setup.mechanism.rig.drives[self.drive].nominal_force.value])

    @property
    def stds(self) -> Floats:
        """Anywhere within the limits h of the play, h/√3, and the sensor's noise [N, N m]."""
        return np.array([float(np.hypot(self.limit / np.sqrt(3.0), np.sqrt(variance(self.sensor))))])

    @cached_property
    def limit(self) -> float:
        """Limit h of the play [N, N m] at pre-tension, with the joints where they start."""
        mechanism = self.setup.mechanism
        tensions = ca.DM([tendon.pretension.value for tendon in mechanism.rig.tendons])
        angles = [joint.initial.value for joint in mechanism.rig.joints]
        limit = mechanism.hysteresis_limit(self.drive, ca.vertcat(*angles, ca.DM.zeros(mechanism.n_drives)), tensions)
        p = mechanism.parameters
        return float(ca.Function("limit", [p.symbols], [limit])(p.values))


@dataclass(frozen=True)
class TransmissionError(State):
    """What one play leaves out of a transmission: considered, since no state of the model is behind it.

    Args:
        setup: the rig.
        drive: index of the drive.
        hysteresis: its description.
    """

    setup: Setup
    drive: int
    hysteresis: Hysteresis | SliderHysteresis

    @property
    def names(self) -> tuple[str, ...]:
        """``transmission_error_DRIVE``."""
        return (f"transmission_error_{self.setup.mechanism.rig.drives[self.drive].name}",)

    @property
    def means(self) -> Floats:
        """None is expected [N, N m]."""
        return np.zeros(1)

    @property
    def stds(self) -> Floats:
        """``hysteresis.error`` [N, N m]."""
        return np.array([self.hysteresis.error])

    @property
    def considered(self) -> bool:
        """It is: its uncertainty counts, but it is never estimated."""
        return True

    def fading(self, dt: Any) -> Fading:
        """Return e^{−dt/T} with T = ``hysteresis.error_time``, and the std [N, N m].

        Args:
            dt: length of the interval [s].
        """
        path = f"drives.{self.drive}.hysteresis"
        error = self.setup.number(f"{path}.error", self.hysteresis.error)
        return Fading(ca.exp(-dt / self.setup.number(f"{path}.error_time", self.hysteresis.error_time)), error)

    def force(self, drive: int, own: Any) -> Any:
        """Return minus the error where it is this drive's: what is transmitted lacks it [N, N m].

        Args:
            drive: its index.
            own: the error.
        """
        return -own[0] if drive == self.drive else 0


def transmissions(setup: Setup) -> list[State]:
    """Return the blocks of each drive with hysteresis and a force sensor.

    Args:
        setup: the rig.
    """
    blocks: list[State] = []
    for i, drive in enumerate(setup.mechanism.rig.drives):
        sensor = setup.force_sensor(i)
        if sensor is None or drive.hysteresis is None:
            continue
        blocks.append(Transmitted(setup, i, sensor))
        if drive.hysteresis.error > 0.0:
            blocks.append(TransmissionError(setup, i, drive.hysteresis))
    return blocks

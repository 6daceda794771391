"""The obvious estimator: the angle as least squares of what the sensors read."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.estimators.affine.homing import EXPECTED, corrected, learned_alone
from distal.estimators.affine.kernel import affine_function, numbers_of, prior_of
from distal.estimators.affine.mapping import noise_of
from distal.estimators.affine.readings import NAME, dead_bands, readings_of
from distal.estimators.channels import Channels, channels_of
from distal.estimators.contract import KernelEstimator
from distal.kernels import Kernel
from distal.logs import Log
from distal.rig import Affine, Rig, angle_names

Floats = NDArray[np.float64]

OUTSIDE = "outside_range"
"""The state that says how far readings are outside the learned range, in halves of it; 0 within."""

NOTICED = 0.1
"""Readings this far outside the learned range, in halves of it, are said; the band grows from the range's end on."""

NEEDS = "needs [affine] in the rig file (distal fit with logs whose angle is known), or a homing move (--homing 3s)"
"""What to do where there is no map."""


class AffineEstimator(KernelEstimator):
    """θ = b0 + Σ b_i s_i + Σ c_j direction_j, from `[affine]` of the rig or a homing move; see `affine_function`.

    Args:
        rig: the description.
        compiled: compile its kernel where possible.
        homing: whether a homing move will follow (`after_homing`), so that no stored map is needed.

    Raises:
        EstimationError: there is no map, or it is one of other sensors.
    """

    def __init__(self, rig: Rig, compiled: bool = True, homing: bool = False) -> None:
        channels = channels_of(rig, NAME)
        if rig.affine is None and not homing:
            raise EstimationError(f"affine: '{rig.name}' has no map of what its sensors read; it {NEEDS}")
        _check_sensors(rig, channels)
        counts = (len(rig.joints), len(channels.names), len(channels.positions))
        self._setup(rig, channels, Kernel(affine_function(*counts), compiled), rig.affine)

    def _setup(
        self, rig: Rig, channels: Channels, kernel: Kernel, affine: Affine | None, notes: tuple[str, ...] = ()
    ) -> None:
        self.affine, self._channels, self._noise, self._notes = affine, channels, noise_of(rig), notes
        names = angle_names([joint.name for joint in rig.joints])
        p = np.full(kernel.n_p, np.nan) if affine is None else numbers_of(affine, self._noise)
        super().__init__(NAME, rig, kernel, p, channels.names, (), (*names, OUTSIDE), channels.interval)

    def after_homing(self, log: Log, homing: float) -> AffineEstimator:
        """Return the estimator with the map that a log's homing move teaches: alone, or as a correction of the rig's.

        Args:
            log: with the truth of the joints in the window.
            homing: length of the window from the log's first sample [s].

        Raises:
            EstimationError: the window has too few samples.
        """
        affine = self.affine
        readings = readings_of(log, self.rig, dead_bands(self.rig) if affine is None else affine.dead_band)
        window = readings.part(readings.time < homing)
        notes: tuple[str, ...] = ()
        if not np.isfinite(window.angles).any() or len(window.time) < 2:
            raise EstimationError(
                f"{log.source}: in the first {homing:g} s there are no samples with all sensors and the reference, which "
                "affine needs; home for longer"
            )
        if affine is None:
            made = learned_alone(window, self.rig, dead_bands(self.rig))
            notes = tuple(f"affine: not used, {text}" for text in made.dropped)
        else:
            made, off = corrected(affine, window, self.rig)
            if off > EXPECTED:
                notes = (
                    f"affine: the homing move is {off:.1f} standard deviations from the map that the rig file has; "
                    "that map counted less",
                )
        other = object.__new__(AffineEstimator)
        other._setup(self.rig, self._channels, self.kernel, made, notes)
        return other

    def prior_function(self) -> ca.Function:
        """Return (values, mask, p) → (mean, covariance's diagonal, memory) before the first sample.

        Raises:
            EstimationError: there is no map yet.
        """
        if self.affine is None:
            raise EstimationError(f"affine: '{self.rig.name}' has no map before its homing move; it {NEEDS}")
        joints = self.rig.joints
        angles, stds = np.array([j.initial.value for j in joints]), np.array([j.initial.std for j in joints])
        return prior_of(self.affine, angles, stds, len(self._p))

    def notes_of(self, means: Floats, samples: Floats) -> tuple[str, ...]:
        """Return what a user should know of an estimate: how much of it was outside the learned range, and of what.

        Args:
            means: states over the log, (k, n).
            samples: values of `channels`, (k, n_channels).
        """
        far = means[:, self.state_names.index(OUTSIDE)]
        if self.affine is None or not np.any(far > NOTICED):
            return self._notes
        low, high = np.asarray(self.affine.low), np.asarray(self.affine.high)
        with np.errstate(invalid="ignore"):
            left = [name for i, name in enumerate(self.channels) if np.any(_beyond(samples[:, i], low[i], high[i]))]
        what = ", ".join(left) if left else "the sensors' combination"
        share = 100.0 * float(np.mean(far > NOTICED))
        logs = self.affine.logs
        learned = "the homing move" if logs == 0 else "the one log" if logs == 1 else f"the {logs} logs"
        note = (
            f"affine: {share:.2g} % of the samples are outside the range of {learned} that it was learned from ({what}), "
            f"by up to {float(far.max()):.2g} of half that range; the band is wider there"
        )
        return (*self._notes, note)


def _beyond(values: Floats, low: float, high: float) -> NDArray[np.bool_]:
    return (values < low) | (values > high)


def _check_sensors(rig: Rig, channels: Channels) -> None:
    affine = rig.affine
    if affine is None:
        return
    if affine.channels != channels.names or len(affine.dead_band) != len(channels.positions):
        raise EstimationError(
            f"affine: [affine] of '{rig.name}' was learned from the sensors {', '.join(affine.channels)}, the rig now has "
            f"{', '.join(channels.names)}; learn it again (distal fit), or remove [affine]"
        )

"""`affine`, the baseline estimator: the angle as a sum of terms of the readings, whose coefficients
are learned by least squares from logs or from a homing move.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators.estimator_protocol import KernelEstimator
from distal.estimators.read_channels import channels_of
from distal.expressions import Scalar
from distal.kernels import Kernel, kernel_state_layout
from distal.kernels.mask import is_read
from distal.logs import Log, frozen, true_angles
from distal.regression import (
    EXPECTED,
    Kind,
    Samples,
    affine_kind,
    calibrate_window,
    first_memory,
    fit_coefficients,
    map_coefficients_of,
    map_function,
    memory_size,
    seen,
    student,
)
from distal.rig import CONSTANT, LAGS, PLAYS, Affine, LearnedMap, Rig, angle_names
from distal.sensor_errors import variance
from distal.threads import one_blas_thread

NAME = "affine"

OUTSIDE = "outside_range"
"""Name of the state that gives how far readings are outside the learned range, in half ranges; 0
inside.
"""

NOTICED = 0.1
"""Readings that are further outside the learned range than this, in half ranges, are reported [1];
the band grows from the end of the range on. Source: judgement.
"""

NEEDS = (
    "needs [affine] in the rig file (distal fit with logs whose angle is known), or a homing "
    "move (--homing 3s)"
)
"""The words of a message on what to do where there is no map."""

NOWHERE = 1e6
"""Variance of an angle at the start where the map does not give it [rad²]. Source: judgement."""

START_GROWTH = 10.0
"""Relative growth of the standard deviation at the start, per half range outside the learned range
[1]. Source: judgement.
"""

START_REACH = 1.0
"""Distance from the learned range, in half ranges, from which on the map does not give the start
[1]. Source: judgement.
"""


def affine_of(rig: Rig) -> Kind:
    """Return the kind of map, its terms and its noise, that gives a rig's joint angles from its
    readings.
    """
    channels = channels_of(rig, NAME)
    noise = np.sqrt([variance(sensor) for sensor in channels.proximal])
    joints = rig.joint_names
    return affine_kind(
        channels.names, [sensor.name for sensor in channels.positions], joints, noise
    )


def affine_samples(log: Log, rig: Rig) -> Samples:
    """Return the samples of a log from the first at which every sensor has had a value, with the
    true angles of the joints.

    A missing value is replaced by the last one before it; a true angle is NaN where it is not
    known.

    Raises:
        EstimationError: a sensor is not in the log or has no value.
    """
    names = channels_of(rig, NAME).names
    for name in names:
        if name not in log.channels or not np.isfinite(log.channels[name]).any():
            raise EstimationError(
                f"{log.source}: affine needs the sensor '{name}', which has no value in this log"
            )
    values = np.column_stack([_held(log.channels[name]) for name in names])
    joints = rig.joint_names
    truth = true_angles(log, joints)
    angles = np.full((len(log), len(joints)), np.nan) if truth is None else truth
    started = np.isfinite(values).all(axis=1)
    count = int(started.sum())
    time = (log.time - log.time[0])[started]
    interval = float(np.median(np.diff(log.time))) if len(log) > 1 else 1.0
    no_angles = np.zeros((count, 0))
    no_variances = np.zeros((count, len(joints)))
    return Samples(
        log.source, time, values[started], no_angles, angles[started], no_variances, interval
    )


def _held(values: Floats) -> Floats:
    """Return the values, each missing one replaced by the last before it."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


class AffineEstimator(KernelEstimator):
    """The estimator θ = Σ b_i φ_i of functions φ_i of the readings; see `map_function`.

    The coefficients b_i are those of `[affine]` of the rig, or are learned in a homing move. With
    `homing` the rig needs none, since `after_homing` will give them.

    Raises:
        EstimationError: there is no map, or it was learned from other sensors.
    """

    def __init__(self, rig: Rig, compiled: bool = True, homing: bool = False) -> None:
        channels = channels_of(rig, NAME)
        if rig.affine is None and not homing:
            raise EstimationError(
                f"affine: '{rig.name}' has no map of what its sensors read; it {NEEDS}"
            )
        if rig.affine is not None and rig.affine.channels != channels.names:
            raise EstimationError(
                f"affine: [affine] of '{rig.name}' was learned from the sensors "
                f"{', '.join(rig.affine.channels)}, the rig "
                f"now has {', '.join(channels.names)}; learn it again (distal fit), or remove "
                "[affine]"
            )
        self._compiled = compiled
        self.affine = rig.affine
        self._notes = tuple[str, ...]()
        names = (*angle_names(rig.joint_names), OUTSIDE)
        super().__init__(NAME, rig, None, np.zeros(0), channels=channels, state_names=names)
        if rig.affine is not None:
            self._learn(rig.affine)

    def _learn(self, affine: Affine) -> None:
        """Take a map, with a new kernel where there is none yet."""
        self.affine = affine
        self._p = frozen(map_coefficients_of(affine))
        self._begin = None
        if self._kernel is None:
            self._kernel = Kernel(affine_function(affine, len(self.channels)), self._compiled)

    @one_blas_thread()
    def after_homing(self, log: Log, homing: float) -> AffineEstimator:
        """Return the estimator with a map that the first `homing` s of a log teach.

        The rig's own map is corrected by them; a rig without one gets a map from them alone.

        Raises:
            EstimationError: the window has too few samples.
        """
        samples = affine_samples(log, self.rig)
        notes = tuple[str, ...]()
        early = samples.time < homing
        window = samples.part(early)
        if not np.isfinite(window.targets).any() or len(window.time) < 2:
            raise EstimationError(
                f"{log.source}: in the first {homing:g} s there are no samples with all sensors "
                "and the reference, which "
                "affine needs; home for longer"
            )
        if self.affine is None:
            corrected = learned_alone(window, affine_of(self.rig))
            notes = tuple(f"affine: not used, {text}" for text in corrected.dropped)
        else:
            calibrated, off = calibrate_window(self.affine, samples, early, by_motion=True)
            corrected = seen(calibrated, window)
            if off > EXPECTED:
                notes = (
                    f"affine: the homing move is {off:.1f} standard deviations from the map that "
                    "the rig file has; "
                    "that map counted less",
                )
        assert isinstance(corrected, Affine)
        taught = copy(self)
        taught._notes = notes
        taught._learn(corrected)
        return taught

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance's diagonal, memory) before the
        first sample.

        Raises:
            EstimationError: there is no map yet.
        """
        if self.affine is None:
            raise EstimationError(
                f"affine: '{self.rig.name}' has no map before its homing move; it {NEEDS}"
            )
        m = len(self.affine.channels)
        values = ca.SX.sym("values", m)
        mask = ca.SX.sym("mask", m)
        p = ca.SX.sym("p", len(self._p))
        joints = self.rig.joints
        mean = ca.SX(ca.DM([*(joint.initial.value for joint in joints), 0.0]))
        spread = ca.SX(ca.DM([*(joint.initial.std**2 for joint in joints), 0.0]))
        return ca.Function(
            "prior", [values, mask, p], [mean, spread, first_memory(self.affine, values, mask)]
        )

    def notes_of(self, means: Floats, samples: Floats) -> tuple[str, ...]:
        """Return sentences on the homing move and on the share of the samples outside the learned
        range, with the sensors that were outside.
        """
        far = means[:, self.state_names.index(OUTSIDE)]
        if self.affine is None or not np.any(far > NOTICED):
            return self._notes
        low = np.asarray(self.affine.low)
        high = np.asarray(self.affine.high)
        with np.errstate(invalid="ignore"):
            beyond = np.any((samples < low) | (samples > high), axis=0)
        left = [name for name, is_beyond in zip(self.channels, beyond) if is_beyond]
        causes = ", ".join(left) if left else "the sensors' combination"
        share = 100.0 * float(np.mean(far > NOTICED))
        logs = self.affine.logs
        learned = (
            "the homing move" if logs == 0 else "the one log" if logs == 1 else f"the {logs} logs"
        )
        note = (
            f"affine: {share:.2g} % of the samples are outside the range of {learned} that it was "
            f"learned from ({causes}), "
            f"by up to {float(far.max()):.2g} of half that range; the band is wider there"
        )
        return (*self._notes, note)


def affine_function(affine: Affine, width: int) -> ca.Function:
    """Return the estimator's function (kernel_state, x, p) → (kernel_state⁺, y); `width` is the
    number of channels.

    The angle is the value of the map, see `map_function`.
    """
    nj = len(affine.joints)
    layout = kernel_state_layout(nj + 1, map=memory_size(affine))
    kernel_state = ca.SX.sym("kernel_state", layout.size)
    x = ca.SX.sym("x", 1 + 2 * width)
    p = ca.SX.sym("p", len(map_coefficients_of(affine)))
    no = ca.SX.zeros(nj)
    function = map_function(affine, width, [False] * width)
    values, _, variances, far, memory = function.call(
        [layout.part(kernel_state, "map"), x, ca.SX.zeros(width), no, p], True
    )
    spread = ca.diag(ca.vertcat(variances, 0))
    following = layout.joined(mean=ca.vertcat(values, far), covariance=spread, map=memory)
    return ca.Function(
        "affine",
        [kernel_state, x, p],
        [following, ca.SX.zeros(1)],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


def learned_alone(window: Samples, kind: Kind) -> LearnedMap:
    """Return the map that a homing move alone teaches: least squares over its window, without terms
    of directions.

    The window's residuals are correlated: N samples count as one, so that k samples tell as much as
    k/N. The band is that of Student's distribution with the k/N − n degrees of freedom that n
    coefficients leave.

    Raises:
        EstimationError: the window has too few samples.
    """
    straight = kind.sets[0]
    needed = len(straight.terms) + 2
    count = int(np.isfinite(window.targets).all(axis=1).sum())
    if count < needed:
        raise EstimationError(
            f"{window.source}: the homing window has {count} samples with a reference, affine "
            "needs "
            f"{needed} or more; home for longer, or learn from logs (distal fit)"
        )
    learned = fit_coefficients([window], kind, straight)
    freedom = max(
        len(window.time) * window.interval / learned.correlation_time - len(straight.terms), 1.0
    )
    wider = student(freedom)
    return learned.model_copy(update={"logs": 0, "band": tuple(wider * c for c in learned.band)})


def start_of(
    affine: Affine, joint: int, readings: Mapping[str, tuple[Scalar, Scalar]]
) -> tuple[Scalar, Scalar]:
    """Return angle and variance of a joint at the first readings, at which the states of plays and
    lags are unknown.

    Outside the learned range the standard deviation grows; from `START_REACH` on, or with a missing
    reading, the variance is `NOWHERE`.

    Args:
        joint: index of the joint.
        readings: channel → its first reading, and 1 where there is one, symbolic.
    """
    learned = affine.joints[joint]
    phi = dict[str, Scalar]()
    complete = ca.SX(1)
    far = ca.SX(0)
    for i, name in enumerate(affine.channels):
        reading, mask = readings[name]
        phi[name] = (reading - affine.centre[i]) / affine.scale[i]
        half = max((affine.high[i] - affine.low[i]) / 2, 1e-12)
        far = ca.fmax(far, ca.fmax(affine.low[i] - reading, reading - affine.high[i]) / half)
        complete = ca.logic_and(complete, is_read(mask))
    # the state of a play is within its half-width of its reading, that of a lag is the reading
    # where the drive rests; a direction is +1 or −1
    states = {
        f"{play}({name})": (name, ratio * width)
        for name, width in zip(affine.channels, affine.width)
        for play, ratio in (*PLAYS.items(), *dict.fromkeys(LAGS, 0.0).items())
    }
    # a product bends most at the ends of the range, where motions begin: it counts as doubt alone
    values = {
        CONSTANT: ca.SX(1),
        **phi,
        **{state: phi[name] for state, (name, _) in states.items()},
    }
    plain = [i for i, term in enumerate(affine.terms) if term in values]
    turns = [i for i in range(len(affine.terms)) if i not in plain]
    column = ca.vertcat(*(values[affine.terms[i]] for i in plain))
    covariance = np.asarray(learned.covariance)[np.ix_(plain, plain)]
    coefficients = np.asarray(learned.coefficients)
    angle = ca.dot(ca.DM(coefficients[plain]), column)
    variance_of = affine.band[joint] ** 2 * (
        affine.between**2 * ca.bilin(ca.DM(covariance), column, column) + learned.std**2
    )
    widths = np.array([states.get(affine.terms[i], ("", 0.0))[1] for i in plain])
    variance_of += float(
        np.sum(coefficients[turns] ** 2) + np.sum((coefficients[plain] * widths) ** 2) / 3.0
    )
    near = ca.logic_and(complete, far < START_REACH)
    return angle, ca.if_else(near, variance_of * (1 + START_GROWTH * far) ** 2, NOWHERE)

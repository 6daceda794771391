"""Extended Kalman filters on the full state, as in the 2008 paper: forces are inputs, displacements
are measured. docs/results/reproduction.md says which equation is where.

Derivatives are propagated from sub-step to sub-step over the interval between two samples; updates
are sequential and scalar, in Joseph's form.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators.estimator_protocol import (
    UNKNOWN_POSITION,
    Belief,
    KernelEstimator,
    StateKind,
    channels_of,
    sensor_for,
)
from distal.estimators.kinematic import error_of, first_drives, symmetric
from distal.expressions import Matrix, Vector, dense_function, symbols
from distal.kernels import Kernel, Layout, kernel_state_layout
from distal.logs import frozen
from distal.model import Kick, Mechanism, Moment, damped_inertias, kick_and_drift, substeps
from distal.rig import Rig, angle_names, speed_names
from distal.sensor_models import variance


def predict_covariance(
    covariance: Matrix,
    transition: Matrix,
    input_map: Matrix,
    input_variances: Vector,
    process: Vector,
) -> Matrix:
    """Return the predicted covariance P⁻ = Φ P Φᵀ + G diag(q_u) Gᵀ + diag(q).

    Args:
        covariance: P, (n, n).
        transition: Φ = ∂x⁺/∂x, (n, n).
        input_map: G = ∂x⁺/∂u, (n, k).
        input_variances: q_u, (k,).
        process: variances q that are added to the states, (n,).
    """
    mapped = input_map * ca.repmat(input_variances.T, input_map.size1(), 1)
    added = ca.mtimes(mapped, input_map.T) + ca.diag(process)
    predicted = symmetric(ca.mtimes(ca.mtimes(transition, covariance), transition.T) + added)
    return with_least(predicted, ca.diag(added))


def with_least(covariance: Matrix, least: Vector) -> Matrix:
    """Return the `covariance` with each variance raised to `least`, (n,), where it is below.

    Only rounding brings a variance there: where one state is known 1e16 times as well as another,
    terms cancel to less than their rounding.
    """
    diagonal = ca.diag(covariance)
    return covariance + ca.diag(ca.fmax(diagonal, least) - diagonal)


def update(
    mean: Vector,
    covariance: Matrix,
    residuals: Vector,
    jacobian: Matrix,
    variances: Vector,
    mask: Vector,
) -> tuple[Vector, Matrix, Vector, Vector]:
    """Return mean, covariance, innovations and their variances after a sample, one scalar at a
    time.

    For each value: ν = z − h(x⁻) − H (x − x⁻), S = H P Hᵀ + R, K = P Hᵀ/S, x ← x + K ν, P ← (I − K
    H) P (I − K H)ᵀ + K R Kᵀ (Joseph), multiplied out: P − K aᵀ − a Kᵀ + K S Kᵀ with a = P Hᵀ. The
    linearisation stays that at x⁻ and the errors of the values are independent, so that this equals
    the update with all values at once.

    Args:
        mean: x⁻, (n,).
        covariance: P, (n, n).
        residuals: z − h(x⁻), (m,).
        jacobian: H, (m, n).
        variances: R, (m,).
        mask: READ or MISSING, see `distal.kernels.layout`, (m,); a value that is MISSING changes
            nothing.
    """
    prior = mean
    innovations = []
    spreads = []
    for i in range(residuals.numel()):
        row = jacobian[i, :]
        across = ca.mtimes(covariance, row.T)
        spread = ca.fmax(ca.mtimes(row, across), 0) + variances[i]
        innovation = residuals[i] - ca.mtimes(row, mean - prior)
        gain = mask[i] * across / spread
        mean = mean + gain * innovation
        change = across - gain * (spread / 2)
        after = symmetric(covariance - (ca.mtimes(gain, change.T) + ca.mtimes(change, gain.T)))
        covariance = with_least(
            after, gain**2 * variances[i]
        )  # the first term of Joseph's form is no less than zero
        innovations.append(innovation)
        spreads.append(spread)
    return mean, covariance, ca.vertcat(*innovations), ca.vertcat(*spreads)


def tangent_step(mechanism: Mechanism, count: int) -> ca.Function:
    """Return the function (q, v, effort, effort_end, dt, p) → (q⁺, v⁺, S) of an interval of `count`
    sub-steps, with S = ∂(q⁺, v⁺)/∂(q, v, pulls of the drives).

    S, (2 n_bodies, 2 n_bodies + n_drives), is propagated from sub-step to sub-step: S_v⁺ = ∂v⁺/∂q
    S_q + ∂v⁺/∂v S_v + ∂v⁺/∂effort and S_q⁺ = S_q + h S_v⁺. The derivative of friction is 0 in stick
    and 1 in slip; bodies do not bounce off stops.

    The effort on the bodies changes in a straight line from `effort` to `effort_end`. If it were
    held, its jump at every sample would shake light sliders on stiff tendons. A column of S for a
    pull is the derivative with respect to a shift of both ends.
    """
    n = mechanism.n_bodies
    p = mechanism.parameters.symbols
    moving, closing = (_step(mechanism, is_last) for is_last in (False, True))
    (length,) = symbols(ca.SX, length=1)
    added = damped_inertias(mechanism.dampings(), mechanism.inertias(), length)
    prepared = ca.Function("damped", [length, p], [added])

    inputs = symbols(ca.MX, q=n, v=n, effort=n, effort_end=n, dt=1, p=p.numel())
    q, v, effort, effort_end, dt, p = inputs
    h = dt / count
    half = h / 2, h, prepared(h / 2, p)
    full = h, h, prepared(h, p)
    # transposed: the slopes of one body lie side by side, so that a processor takes several at once
    identity = ca.DM.eye(2 * n + mechanism.n_drives)
    s_q = ca.MX(ca.densify(identity[:, :n]))
    s_v = ca.MX(ca.densify(identity[:, n : 2 * n]))
    for i, step in enumerate([half] + [full] * (count - 1)):
        pull = effort + (i / count) * (effort_end - effort)
        q, v, s_q, s_v = moving(q, v, s_q, s_v, pull, *step, p)
    _, v, _, s_v = closing(q, v, s_q, s_v, effort_end, *half, p)
    return ca.Function("tangent_interval", inputs, [q, v, ca.horzcat(s_q, s_v).T])


def _step(mechanism: Mechanism, is_last: bool) -> ca.Function:
    """Return the function of a kick and the drift that follows, unless it is the last kick, which
    also propagates the slopes.

    (q, v, S_qᵀ, S_vᵀ, effort, length, drift, damped, p) → (q⁺, v⁺, S_qᵀ⁺, S_vᵀ⁺).
    """
    n = mechanism.n_bodies
    slopes = 2 * n + mechanism.n_drives, n
    of_kick = symbols(ca.SX, q=n, v=n, effort=n, length=1, drift=1, damped=n)
    q, v, effort, length, drift, damped = of_kick
    kick = Kick(q, v, effort, length, drift, damped=damped)
    moved = kick_and_drift(mechanism, kick, last=is_last)
    by_q, by_v, by_effort = (ca.jacobian(moved[1], by).T for by in of_kick[:3])
    by_pulls = ca.vertcat(ca.SX(2 * n, n), by_effort[mechanism.n_joints :, :])
    dense = [ca.densify(output) for output in (by_pulls, *moved)]
    p = mechanism.parameters.symbols
    outputs = ca.cse([ca.sparsify(by_q), ca.sparsify(by_v), *dense])
    kicked = ca.Function("kick", [*of_kick, p], outputs)
    inputs = symbols(
        ca.MX,
        q=n,
        v=n,
        s_q=slopes,
        s_v=slopes,
        effort=n,
        length=1,
        drift=1,
        damped=n,
        p=p.numel(),
    )
    q, v, s_q, s_v, effort, length, drift, *more = inputs
    by_q, by_v, by_pulls, q, v = kicked(q, v, effort, length, drift, *more)
    # S_v⁺ = ∂v⁺/∂q S_q + ∂v⁺/∂v S_v + ∂v⁺/∂effort, transposed
    s_v = ca.mac(s_v, by_v, ca.mac(s_q, by_q, by_pulls))
    s_q = s_q if is_last else s_q + drift * s_v
    return ca.Function("last_kick" if is_last else "substep", inputs, [q, v, s_q, s_v])


@dataclass(frozen=True)
class Noise:
    """Variances of a full-state filter, SI.

    Args:
        inputs: of the pull on each drive, (n_drives,).
        process: of each state, per second, (n,).
        measurements: of measured positions, then of measured tensions, (m,).
        initial: of the states before the first sample, (n,).
    """

    inputs: Floats
    process: Floats
    measurements: Floats
    initial: Floats


class FullStateFilter(KernelEstimator):
    """An extended Kalman filter whose state is (q, v) of the whole mechanism.

    The kernel state is (mean, covariance, last pulls); p = (parameters, input, process and
    measurement variances). Over an interval a pull goes in a straight line from its last value to
    the new one; a missing one keeps its last value.

    Args:
        name: of the estimator.
        rig: the description.
        noise: the filter's variances.
        compiled: whether the kernel is compiled where possible.
        passes: how often it goes over a log. A second pass begins with the last covariance of the
            first, as the paper's filter did. A live estimator has one pass.

    Raises:
        EstimationError: the sensors do not suffice, or a joint is coupled.
        RigError: the rig is too stiff for its interval.
    """

    def __init__(
        self, name: str, rig: Rig, noise: Noise, compiled: bool = True, passes: int = 1
    ) -> None:
        coupled = [joint.name for joint in rig.joints if joint.coupled is not None]
        if coupled:
            raise EstimationError(
                f"{name}: a coupled joint ({', '.join(coupled)}) has no state of its own here; "
                "use adaptive or elastic"
            )
        self._mechanism = Mechanism(rig)
        self._channels = channels_of(rig, name)
        self._noise = noise
        self._passes = passes
        channels = self._channels
        self._measured = (*channels.positions, *channels.tensions)
        self._count = substeps(self._mechanism, channels.interval)
        kernel = Kernel(self._function(), compiled)
        parameters = self._mechanism.parameters.values
        p = np.concatenate([parameters, noise.inputs, noise.process, noise.measurements])
        measured = tuple(sensor.name for sensor in self._measured)
        super().__init__(
            name, rig, kernel, p, channels=channels, state_names=state_names(rig), measured=measured
        )
        joints, drives = rig.joint_names, rig.drive_names
        others = (StateKind.OTHER,) * len(drives)
        angles, speeds = ((kind,) * len(joints) for kind in (StateKind.ANGLE, StateKind.SPEED))
        self.state_kinds = (*angles, *others, *speeds, *others)
        self.state_parts = (*joints, *drives, *joints, *drives)

    def _function(self) -> ca.Function:
        """Return the function (kernel_state, x, p) → (kernel_state⁺, y)."""
        mechanism = self._mechanism
        nb = mechanism.n_bodies
        nd = mechanism.n_drives
        nj = mechanism.n_joints
        n = 2 * nb
        channels = self._channels
        m = len(self._measured)
        layout = kernel_state_layout(n, pulls=nd)
        of = Layout(model=len(mechanism.parameters), inputs=nd, process=n, measurements=m)
        inputs = symbols(ca.MX, kernel_state=layout.size, x=channels.row.size, p=of.size)
        kernel_state, x, p = inputs
        model, *variances = of.parts(p).values()
        mean, covariance, held = layout.parts(kernel_state).values()
        dt, values, mask = channels.row.parts(x).values()

        pulls = [held[i] for i in range(nd)]
        drives = mechanism.rig.drive_names
        for sensor in channels.forces:
            i = drives.index(sensor.of)
            k = channels.names.index(sensor.name)
            pulls[i] = mask[k] * values[k] + (1 - mask[k]) * held[i]
        pull = ca.vertcat(*pulls)
        before, after = (ca.vertcat(ca.MX.zeros(nj), pulls) for pulls in (held, pull))
        q_next, v_next, slopes = tangent_step(mechanism, self._count)(
            mean[:nb], mean[nb:], before, after, dt, model
        )
        arguments = q_next, v_next, slopes, covariance, dt, values[:m], mask[:m], model, *variances
        mean, covariance, *y = self._update_function()(*arguments)
        following = layout.joined(mean=mean, covariance=covariance, pulls=pull)
        return ca.Function("full_state", inputs, [following, ca.vertcat(*y)])

    def _update_function(self) -> ca.Function:
        """Return prediction of the covariance and update as one scalar function."""
        mechanism = self._mechanism
        nb = mechanism.n_bodies
        nd = mechanism.n_drives
        n = 2 * nb
        m = len(self._measured)
        p = mechanism.parameters.symbols
        before = symbols(ca.SX, q=nb, v=nb, slopes=(n, n + nd), P=(n, n), dt=1, z=m, mask=m)
        q, v, slopes, covariance, dt, values, mask = before
        variances = symbols(ca.SX, q_u=nd, q_x=n, r=m)
        q_u, q_x, r = variances
        state = ca.vertcat(q, v)
        predicted = predict_covariance(covariance, slopes[:, :n], slopes[:, n:], q_u, q_x * dt)
        expected = self._expected(q, v)
        updated = update(state, predicted, values - expected, ca.jacobian(expected, state), r, mask)
        return dense_function("update", [*before, p, *variances], updated)

    def _expected(self, q: Vector, v: Vector) -> Vector:
        """Return h(x), what position and tension sensors should read at q and v: s + bias, and T +
        bias.
        """
        mechanism = self._mechanism
        efforts = ca.SX(mechanism.n_bodies, 1)
        moment = Moment(mechanism, q, v, mechanism.tensions(q, v), efforts)
        return ca.vertcat(*(moment.read(sensor) + sensor.bias.value for sensor in self._measured))

    def beginning(self, times: Floats, samples: Floats) -> Belief:
        """Return the belief before the first sample of a log, whose covariance is the last one of
        the pass before.
        """
        first = super().beginning(times, samples)
        n = first.size
        begin = first
        for _ in range(self._passes - 1):
            belief = begin
            for rows in np.array_split(np.arange(len(times)), 1 + len(times) // ROWS):
                states, _ = self.advanced(belief, times[rows], samples[rows])
                last = frozen(states[-1].copy())
                belief = Belief(float(times[rows[-1]]), last, n, belief.samples + len(rows))
            state = first.kernel_state.copy()
            state[n : n + n * n] = belief.kernel_state[n : n + n * n]
            begin = Belief(first.time, frozen(state), n)
        return begin

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance's diagonal, memory) before the
        first sample.
        """
        inputs = self._first_sample()
        values, mask, _ = inputs
        positions, pulls = first_drives(self.rig, self._channels, values, mask)
        angles = ca.DM([joint.initial.value for joint in self.rig.joints])
        mean = ca.vertcat(angles, positions, ca.SX.zeros(self._mechanism.n_bodies))
        return ca.Function("prior", inputs, [mean, ca.SX(ca.DM(self._noise.initial)), pulls])


def state_names(rig: Rig) -> tuple[str, ...]:
    """Return the names of the states (q, v): angles, drives' positions, angular speeds, drives'
    velocities.
    """
    drives = rig.drive_names
    joints = rig.joint_names
    positions, velocities = (
        tuple(f"{kind}_{drive}" for drive in drives) for kind in ("position", "velocity")
    )
    return (*angle_names(joints), *positions, *speed_names(joints), *velocities)


def rig_noise(rig: Rig) -> Noise:
    """Return the variances of `ekf`, all of them from the rig.

    A measured force is an input with its sensor's noise; a nominal one has its std. The error of a
    position is its random error and its linearity, as if both were random from sample to sample.
    The process noise is zero.
    """
    channels = channels_of(rig, "ekf")
    forces = [(drive, sensor_for(channels.forces, drive.name)) for drive in rig.drives]
    inputs = [
        drive.nominal_force.std**2 if sensor is None else variance(sensor)
        for drive, sensor in forces
    ]
    measured = (*channels.positions, *channels.tensions)
    measurements = np.array([error_of(sensor) for sensor in measured])
    # a joint's from the rig, a drive's from its sensor
    angles = [joint.initial.std for joint in rig.joints]
    positions = []
    for drive in rig.drives:
        sensor = sensor_for(channels.positions, drive.name)
        if sensor is not None:
            positions.append(np.sqrt(error_of(sensor)))
        elif drive.stops is not None:
            positions.append((drive.stops[1] - drive.stops[0]) / np.sqrt(12.0))
        else:
            positions.append(UNKNOWN_POSITION[drive.kind])
    turns = [True] * len(angles) + [drive.kind == "capstan" for drive in rig.drives]
    initial = np.array([*angles, *positions, *(START_SPEED[turning] for turning in turns)]) ** 2
    return Noise(np.array(inputs), np.zeros(len(initial)), measurements, initial)


START_SPEED = {True: 0.5, False: 0.005}
"""Whether a body turns → standard deviation of its velocity at the first sample: of an angle
[rad/s], of a slider [m/s]. Source: judgement.
"""


def paper_noise(rig: Rig) -> Noise:
    """Return the variances of `ekf-2008`: Q = 0.001·I per nominal interval, R = 1e-9·I, P0 = I, all
    in SI.

    The paper prints 0.001 for Q and R without units. R = 0.001 m² would be a sensor that errs by 32
    mm, three times its travel, so R is read in mm², 1e-9 m²; docs/results/reproduction.md compares
    the readings.
    """
    channels = channels_of(rig, "ekf-2008")
    drives = len(rig.drives)
    n = 2 * (len(rig.joints) + drives)
    m = len(channels.positions) + len(channels.tensions)
    return Noise(
        np.zeros(drives), np.full(n, 1e-3 / channels.interval), np.full(m, 1e-9), np.ones(n)
    )


ROWS = 10_000
"""Samples whose covariances a first pass holds at once [1]. Source: judgement (4 MB)."""

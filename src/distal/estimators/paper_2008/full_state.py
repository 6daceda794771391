"""Extended Kalman filters on the full state, as in the 2008 paper: forces are inputs, displacements
are measured. docs/results/reproduction.md says which equation is where.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators.belief import Belief
from distal.estimators.estimator_protocol import KernelEstimator
from distal.estimators.kinematic import error_of, first_drives
from distal.estimators.paper_2008.joseph_form import predict_covariance, update
from distal.estimators.paper_2008.tangent_step import tangent_step
from distal.estimators.read_channels import UNKNOWN_POSITION, Channels, channels_of, sensor_for
from distal.estimators.state_kinds import StateKind
from distal.expressions import Vector
from distal.kernels import Kernel, Layout, kernel_state_layout
from distal.logs import frozen
from distal.model import Mechanism, substeps
from distal.rig import Rig, Sensor, angle_names, gain_of, speed_names
from distal.sensor_errors import variance


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


def full_state_function(mechanism: Mechanism, channels: Channels, count: int) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of an extended Kalman filter
    with state (q, v).

    The kernel state is (mean, covariance, last pulls); p = (parameters, input, process and
    measurement variances). Over an interval, of `count` sub-steps, a pull goes in a
    straight line from its last value to the new one; a missing one keeps its last value.
    """
    nb = mechanism.n_bodies
    nd = mechanism.n_drives
    nj = mechanism.n_joints
    n = 2 * nb
    measured = [*channels.positions, *channels.tensions]
    m = len(measured)
    width = len(channels.names)
    layout = kernel_state_layout(n, pulls=nd)
    kernel_state = ca.MX.sym("kernel_state", layout.size)
    x = ca.MX.sym("x", 1 + 2 * width)
    of = Layout(model=len(mechanism.parameters), inputs=nd, process=n, measurements=m)
    p = ca.MX.sym("p", of.size)
    model, *variances = of.parts(p).values()
    mean, covariance, held = layout.parts(kernel_state).values()
    dt = x[0]
    values = x[1 : 1 + width]
    mask = x[1 + width :]

    pulls = [held[i] for i in range(nd)]
    drives = mechanism.rig.drive_names
    for sensor in channels.forces:
        i = drives.index(sensor.of)
        k = channels.names.index(sensor.name)
        pulls[i] = mask[k] * values[k] + (1 - mask[k]) * held[i]
    pull = ca.vertcat(*pulls)
    before, after = (ca.vertcat(ca.MX.zeros(nj), pulls) for pulls in (held, pull))
    q_next, v_next, slopes = tangent_step(mechanism, count)(
        mean[:nb], mean[nb:], before, after, dt, model
    )
    arguments = q_next, v_next, slopes, covariance, dt, values[:m], mask[:m], model, *variances
    mean, covariance, *y = _update_function(mechanism, measured)(*arguments)
    following = layout.joined(mean=mean, covariance=covariance, pulls=pull)
    return ca.Function("full_state", [kernel_state, x, p], [following, ca.vertcat(*y)])


def _update_function(mechanism: Mechanism, measured: Sequence[Sensor]) -> ca.Function:
    """Return prediction of the covariance and update as one scalar function."""
    nb = mechanism.n_bodies
    nd = mechanism.n_drives
    n = 2 * nb
    m = len(measured)
    p = mechanism.parameters.symbols
    q = ca.SX.sym("q", nb)
    v = ca.SX.sym("v", nb)
    slopes = ca.SX.sym("slopes", n, n + nd)
    covariance = ca.SX.sym("P", n, n)
    dt = ca.SX.sym("dt")
    values = ca.SX.sym("z", m)
    mask = ca.SX.sym("mask", m)
    q_u = ca.SX.sym("q_u", nd)
    q_x = ca.SX.sym("q_x", n)
    r = ca.SX.sym("r", m)
    state = ca.vertcat(q, v)
    predicted = predict_covariance(covariance, slopes[:, :n], slopes[:, n:], q_u, q_x * dt)
    expected = expected_measurements(mechanism, measured, q, v)
    updated = update(state, predicted, values - expected, ca.jacobian(expected, state), r, mask)
    arguments = [q, v, slopes, covariance, dt, values, mask, p, q_u, q_x, r]
    return ca.Function("update", arguments, ca.cse([ca.densify(part) for part in updated]))


def expected_measurements(
    mechanism: Mechanism, measured: Sequence[Sensor], q: Vector, v: Vector
) -> Vector:
    """Return h(x), what position and tension sensors should read at q and v: s + bias, and gain · T
    + bias.
    """
    rig = mechanism.rig
    expected = []
    drives = rig.drive_names
    tendons = rig.tendon_names
    for sensor in measured:
        if sensor.measures == "position":
            body = mechanism.n_joints + drives.index(sensor.of)
            expected.append(q[body] + sensor.bias.value)
        else:
            tension = mechanism.tensions(q, v)[tendons.index(sensor.of)]
            expected.append(gain_of(sensor).value * tension + sensor.bias.value)
    return ca.vertcat(*expected)


class FullStateFilter(KernelEstimator):
    """An extended Kalman filter whose state is (q, v) of the whole mechanism; see
    `full_state_function`.

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
        self._count = substeps(self._mechanism, self._channels.interval)
        channels = self._channels
        kernel = Kernel(full_state_function(self._mechanism, channels, self._count), compiled)
        parameters = self._mechanism.parameters.values
        p = np.concatenate([parameters, noise.inputs, noise.process, noise.measurements])
        measured = tuple(sensor.name for sensor in (*channels.positions, *channels.tensions))
        super().__init__(
            name, rig, kernel, p, channels=channels, state_names=state_names(rig), measured=measured
        )
        joints, drives = rig.joint_names, rig.drive_names
        others = (StateKind.OTHER,) * len(drives)
        angles, speeds = ((kind,) * len(joints) for kind in (StateKind.ANGLE, StateKind.SPEED))
        self.state_kinds = (*angles, *others, *speeds, *others)
        self.state_parts = (*joints, *drives, *joints, *drives)

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
        values, mask = (ca.SX.sym(name, len(self._channels.names)) for name in ("values", "mask"))
        positions, pulls = first_drives(self.rig, self._channels, values, mask)
        angles = ca.DM([joint.initial.value for joint in self.rig.joints])
        mean = ca.vertcat(angles, positions, ca.SX.zeros(self._mechanism.n_bodies))
        p = ca.SX.sym("p", len(self._p))
        return ca.Function(
            "prior", [values, mask, p], [mean, ca.SX(ca.DM(self._noise.initial)), pulls]
        )


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
    mechanism = Mechanism(rig)
    forces = [(drive, sensor_for(channels.forces, drive.name)) for drive in rig.drives]
    inputs = [
        drive.nominal_force.std**2 if sensor is None else variance(sensor)
        for drive, sensor in forces
    ]
    measured = (*channels.positions, *channels.tensions)
    measurements = np.array([error_of(sensor) for sensor in measured])
    initial = _initial_variances(rig, channels, mechanism)
    return Noise(np.array(inputs), np.zeros(2 * mechanism.n_bodies), measurements, initial)


def _initial_variances(rig: Rig, channels: Channels, mechanism: Mechanism) -> Floats:
    """Return the variances of (q, v) before the first sample: the joint's from the rig, a drive's
    from its sensor.
    """
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
    turns = [True] * mechanism.n_joints + [drive.kind == "capstan" for drive in rig.drives]
    return np.array([*angles, *positions, *(START_SPEED[turning] for turning in turns)]) ** 2


START_SPEED = {True: 0.5, False: 0.005}
"""Whether a body turns → standard deviation of its velocity at the first sample: of an angle
[rad/s], of a slider [m/s]. Source: judgement.
"""


def paper_noise(rig: Rig, q: float = 1e-3, r: float = 1e-9, p0: float = 1.0) -> Noise:
    """Return the variances of `ekf-2008`: Q = q·I per nominal interval, R = r·I, P0 = p0·I, all in
    SI.

    The paper prints 0.001 for Q and R without units. R = 0.001 m² would be a sensor that errs by 32
    mm, three times its travel, so R is read in mm², 1e-9 m²; docs/results/reproduction.md compares
    the readings.
    """
    channels = channels_of(rig, "ekf-2008")
    mechanism = Mechanism(rig)
    n = 2 * mechanism.n_bodies
    m = len(channels.positions) + len(channels.tensions)
    return Noise(
        np.zeros(mechanism.n_drives),
        np.full(n, q / channels.interval),
        np.full(m, r),
        np.full(n, p0),
    )


ROWS = 10_000
"""Samples whose covariances a first pass holds at once [1]. Source: judgement (4 MB)."""

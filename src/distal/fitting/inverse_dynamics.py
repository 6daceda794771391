"""The residuals of a rig's equations along a log of known angles, for which no filter is needed.

With q = (angles, positions) known, and v and a from it, the equations of `Mechanism` hold at every
sample alone. Their residuals are

    forces      U_i − (pull_i(q, v) + l_i d_i + α_i |d_i|)
    tensions    T_measured − T(q, v)
    joints      −(M a + Coriolis + gravity + pulls − passive forces + l d)_j

Each is divided by its effective standard deviation, √(σ² + Σ (∂row/∂q_k)² σ_k²), which has the
noise that smoothing leaves in angles and positions: a stiffness that multiplies their noise would
come out too small (Clutton-Brock, Technometrics 9, 1967). Friction has limits of mean l and
asymmetry α; d is the direction of motion, which turns within a hundredth of the range. Rows of
bodies at rest are not compared, since friction there has any value up to its limit. Internal states
(of plays, points of sheaths, creep) are stepped along the known motion. This is identification by
the inverse dynamic model (Gautier and Khalil, IEEE T-RA 6, 1990; Janot et al., IEEE T-CST 22,
2014).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.expressions import Scalar, Vector
from distal.fitting.likelihood import Data, FitFilter, Innovations, Problem
from distal.kernels import Feed, Kernel, kernel_of, structure_of
from distal.model import Mechanism
from distal.rig import Sensor
from distal.sensor_models import variance

INTERVAL = 0.05
"""Interval at which the equations are compared [s], since their residuals change no faster. Source:
judgement.
"""

SMOOTHED = 0.12
"""Length of the window in which positions and angles are smoothed by cubics, which also give their
speeds (Savitzky and Golay, 1964) [s]. Source: judgement.
"""

TURNING_SHARE = 0.01
"""Share of a body's range (its 5 to 95 % quantiles) over which its direction of motion turns.
Source: judgement.
"""

SLOW = 0.03
"""Speed of a body, per its RMS speed, below which its residual is not compared. Source: benchmark
(docs/results/from-logs.md).
"""

FEWEST_SAMPLES = 100
"""Least number of samples with all angles and positions that every log needs, so that the equations
are asked. Source: judgement.
"""

POWER = 0.1
"""Power of the likelihood beside the priors [1]. No rig has all physics of its logs, and equations
have no state that holds what they lack: with 1, parameters that show only together carry it (power
posterior; Holmes and Walker, Biometrika 104, 2017; Miller and Dunson, J. American Statistical
Association 114, 2019). Source: benchmark (docs/results/from-logs.md).
"""

LEAST_VARIANCE = 1e-18
"""Least effective variance of a residual [SI²]. Source: rounding (division by zero)."""


@dataclass(frozen=True)
class KnownMotion:
    """A log as the equations take it.

    Args:
        rows: rows of the kernel, (k, n_x).
        time: stamps [s], (k,).
        compared: whether each residual of each row is compared, (k, m).
    """

    rows: Floats
    time: Floats
    compared: Bools


class Equations:
    """The equations of a rig and its sensors as one kernel of known motion; its parameters are
    those of the fit's filter.
    """

    def __init__(self, fit: FitFilter, compiled: bool = True) -> None:
        context = fit.states.context
        self.context = context
        self.mechanism = context.mechanism
        self.fit = fit
        drives = range(context.n_drives)
        self.positions = [s for i in drives if (s := context.position_sensor(i)) is not None]
        self.forces = [(i, s) for i in drives if (s := context.force_sensor(i)) is not None]
        tendons = self.mechanism.rig.tendon_names
        self.tensions = [(tendons.index(s.of), s) for s in context.channels.tensions]
        self.sensors = [sensor for _, sensor in (*self.forces, *self.tensions)]
        structure = structure_of("equations", self.mechanism, channels=context.channels.names)
        self.kernel = kernel_of(structure, self._function, "lanes" if compiled else False)
        self.begin = self._begin()

    @staticmethod
    def apply_to(fit: FitFilter) -> bool:
        """Return whether every drive's position and every joint's angle has a sensor, so that the
        equations can be asked.
        """
        context = fit.states.context
        read = {sensor.of for sensor in fit.references}
        positions = [context.position_sensor(i) for i in range(context.n_drives)]
        return None not in positions and read >= set(fit.rig.joint_names)

    def _function(self) -> ca.Function:
        """Return the function (kernel_state, x, p) → (kernel_state⁺, residuals).

        The kernel state is (directions, internal states), x is (dt, turned, q, v, a, σ_q²,
        readings).
        """
        mechanism = self.mechanism
        context = self.context
        nb = self.mechanism.n_bodies
        nj = self.mechanism.n_joints
        p = mechanism.parameters.symbols
        count = len(mechanism.plays) + len(mechanism.strains)
        kernel_state = ca.SX.sym("kernel_state", nb + count)
        x = ca.SX.sym("x", 1 + 5 * nb + len(self.sensors))
        ends = [0, 1, *(1 + nb * k for k in range(1, 6)), x.numel()]
        dt, turned, motion, v, a, unsure, read = ca.vertsplit(x, ends)
        positions = [context.corrected(s, motion[nj + i]) for i, s in enumerate(self.positions)]
        q = ca.vertcat(motion[:nj], *positions)
        direction = ca.fmax(ca.fmin(kernel_state[:nb] + turned, 1), -1)
        inside = self._stepped(q, dt, kernel_state[nb:])
        parameters = self._remembering(inside)
        tensions, pulls, balance, up, down = self._forces()(q, v, a, parameters)
        friction = (up + down) / 2 * direction + (up - down) / 2 * ca.fabs(direction)
        rows = [
            context.corrected(s, read[k]) - pulls[nj + i] - friction[nj + i]
            for k, (i, s) in enumerate(self.forces)
        ]
        rows += [
            context.corrected(s, read[k]) - tensions[i]
            for k, (i, s) in enumerate(self.tensions, len(self.forces))
        ]
        rows += ca.vertsplit(-ca.mtimes(ca.densify(mechanism.spread).T, (balance + friction)[:nj]))
        lacking = ca.vertcat(*rows)
        variances = [context.noise(s) for s in self.sensors]
        noise = ca.vertcat(*variances, *(LEAST_VARIANCE for _ in mechanism.free))
        noise += ca.mtimes(ca.jacobian(lacking, motion) ** 2, unsure)
        residuals = lacking / ca.sqrt(ca.fmax(noise, LEAST_VARIANCE))
        outputs = [ca.cse(ca.densify(part)) for part in (ca.vertcat(direction, inside), residuals)]
        return ca.Function(
            "equations", [kernel_state, x, p], outputs, ["kernel_state", "x", "p"], ["next", "y"]
        )

    def _remembering(self, inside: Vector) -> Vector:
        """Return the parameters with what is inside: states of plays, then strains."""
        parameters = ca.SX(self.mechanism.parameters.symbols)
        names = self.mechanism.parameters.names
        for k, name in enumerate((*self.mechanism.plays, *self.mechanism.strains)):
            parameters[names.index(name)] = inside[k]
        return parameters

    def _stepped(self, q: Vector, dt: Scalar, inside: Vector) -> Vector:
        """Return what is inside after a step to the positions q."""
        mechanism = self.mechanism
        p = mechanism.parameters.symbols
        at = ca.SX.sym("q", mechanism.n_bodies)
        step = ca.SX.sym("dt")
        plays = strains = ca.SX(0, 1)
        if inside.numel():
            moved = ca.vertcat(*mechanism.internal_state(at).inside)
            plays = ca.Function("moved", [at, p], [moved])(q, self._remembering(inside))
        if mechanism.strains:
            before = self._remembering(ca.vertcat(plays, inside[len(mechanism.plays) :]))
            crept = ca.vertcat(*mechanism.crept(at, step))
            strains = ca.Function("crept", [at, step, p], [crept])(q, dt, before)
        return ca.vertcat(plays, strains)

    def _forces(self) -> ca.Function:
        """Return the function (q, v, a, p) → (tensions, pulls, all bodies' balance without
        friction, friction limits up and down).
        """
        mechanism = self.mechanism
        nb = mechanism.n_bodies
        nj = mechanism.n_joints
        q, v, a = (ca.SX.sym(name, nb) for name in "qva")
        tendons = mechanism.pulls(q, v, settled=True)
        pulls = mechanism.dampings() * v - tendons.forces - mechanism.passive_forces(q)
        balance = ca.vertcat(mechanism.moving_forces(q, v, a[:nj]) + pulls[:nj], pulls[nj:])
        limits = mechanism.friction_limits(q, v, tendons.joint, tendons.drive)
        up = ca.vertcat(*(limit.up for limit in limits))
        down = ca.vertcat(*(limit.down for limit in limits))
        p = mechanism.parameters.symbols
        return ca.Function("forces", [q, v, a, p], [tendons.drive, pulls, balance, up, down])

    def _begin(self) -> ca.Function:
        """Return the function (q, p) → the kernel state before the first sample: no direction yet,
        plays in the middle, creep settled.
        """
        still = Mechanism(self.mechanism.rig, self.mechanism.parameters.inputs)
        q = ca.SX.sym("q", still.n_bodies)
        p = self.mechanism.parameters.symbols
        symbols = still.parameters.symbols
        inside = list(still.internal_state(q).inside)
        for name in still.strains:
            index = int(name.split(".")[1])
            creep = still.rig.tendons[index].creep
            assert creep is not None
            path = f"tendons.{index}"
            tension = still.pulls(q, ca.SX.zeros(still.n_bodies)).drive[index]
            share = still.parameters[f"{path}.creep.share"]
            stiffness = still.parameters[f"{path}.stiffness"]
            inside.append(creep.settled.value * share * tension / stiffness)
        kernel_state: Scalar = ca.vertcat(ca.SX.zeros(still.n_bodies), *inside)
        return ca.Function(
            "begin", [q, p], ca.substitute([kernel_state], [symbols], [p[: symbols.numel()]])
        )

    def motion_of(self, data: Data) -> KnownMotion | None:
        """Return a log as the equations take it; None where it has too few samples with all angles
        and positions.
        """
        channels = list(self.fit.channels)
        joints = self.mechanism.rig.joint_names

        def columns(sensors: Sequence[Sensor]) -> Floats:
            readings = [data.samples[:, channels.index(sensor.name)] for sensor in sensors]
            return np.column_stack([*readings, np.zeros((len(data.samples), 0))])

        of = {sensor.of: sensor for sensor in self.fit.references}
        of_motion = [*(of[name] for name in joints), *self.positions]
        q = columns(of_motion)
        time = data.log.time
        complete = np.asarray(np.isfinite(q).all(axis=1))
        from scipy.signal import savgol_coeffs, savgol_filter  # takes as long to load as distal

        step = float(np.median(np.diff(time)))
        window = max(5, round(SMOOTHED / step) | 1)
        if np.count_nonzero(complete) < max(FEWEST_SAMPLES, 3 * window):
            return None
        filled = np.column_stack(
            [np.interp(time, time[complete], column[complete]) for column in q.T]
        )
        q, v, a = (savgol_filter(filled, window, 3, k, step, axis=0) for k in range(3))
        width = TURNING_SHARE * np.subtract(*np.percentile(q[complete], (95, 5), axis=0)) + 1e-12
        every = max(1, round(INTERVAL / step))
        at = slice(None, None, every)
        # smoothing leaves this share of the noise's variance of each angle and position
        left = float(np.sum(savgol_coeffs(window, 3) ** 2))
        noise = [variance(sensor) for sensor in of_motion]
        unsure = np.tile(left * np.array(noise), (len(q[at]), 1))
        read = columns(self.sensors)[at]
        turned = np.diff(q[at], axis=0, prepend=q[:1]) / width
        rows = np.column_stack(
            [np.diff(time[at], prepend=time[0]), turned, q[at], v[at], a[at], unsure, read]
        )
        edge = window // every + 1
        inner = np.arange(len(rows))
        inside = np.asarray(complete[at] & (inner >= edge) & (inner < len(rows) - edge))
        return KnownMotion(rows, time[at], inside[:, None] & self._sliding(v)[at])

    def _sliding(self, v: Floats) -> Bools:
        """Return when the friction in each residual is known, (k, m): while its body moves at v,
        (k, n_bodies); in a tension there is none.
        """
        fast = np.abs(v) > SLOW * np.sqrt(np.mean(v**2, axis=0))
        drives = [self.mechanism.n_joints + i for i, _ in self.forces]
        always = np.ones((len(v), len(self.tensions)), dtype=bool)
        return np.column_stack([fast[:, drives], always, fast[:, list(self.mechanism.free)]])


@dataclass(frozen=True, kw_only=True)
class InverseProblem(Problem):
    """−ln p of the residuals of a rig's equations along logs of known angles, at coordinates z; see
    `Problem`.

    Args:
        equations: the equations.
        motions: the logs as the equations take them. The sizes of noises are not varied.
    """

    asks_equations: ClassVar[bool] = True
    power: ClassVar[float] = POWER

    equations: Equations
    motions: tuple[KnownMotion, ...]

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the residuals, (m,): sensors of forces and tensions, then the joints that move
        by themselves.
        """
        mechanism = self.equations.mechanism
        joints = [mechanism.rig.joints[j].name for j in mechanism.free]
        return (*(sensor.name for sensor in self.equations.sensors), *joints)

    @cached_property
    def _is_reference(self) -> Bools:
        return np.zeros(len(self.measured), dtype=bool)

    def _times(self, log: int) -> Floats:
        return self.motions[log].time

    @property
    def _kernel(self) -> Kernel:
        return self.equations.kernel

    @cached_property
    def _rows(self) -> tuple[Floats, ...]:
        return tuple(motion.rows for motion in self.motions)

    def _feed(self, log: int, z: Floats) -> Feed:
        p = self.parameters(z)
        nb = self.equations.mechanism.n_bodies
        rows = self._rows[log]
        return Feed(
            np.asarray(self.equations.begin(rows[0, 1 + nb : 1 + 2 * nb], p)).ravel(), rows, p
        )

    def _compared(self, log: int, ys: Floats) -> Innovations:
        values = np.where(self.motions[log].compared, ys, np.nan)
        return Innovations(values, np.ones(values.shape))


def inverse_problem(problem: Problem, compiled: bool = True) -> InverseProblem | None:
    """Return the equations' problem of the same logs and parameters, without noises; None where the
    equations cannot be asked.
    """
    if not Equations.apply_to(problem.filter):
        return None
    equations = Equations(problem.filter, compiled)
    motions = tuple(
        motion for data in problem.data if (motion := equations.motion_of(data)) is not None
    )
    if len(motions) < len(problem.data):
        return None
    free = tuple(part for part in problem.free if not part.noise)
    noises = tuple(part for part in problem.free if part.noise)
    return InverseProblem(
        problem.filter,
        free,
        problem.data,
        workers=problem.workers,
        equations=equations,
        motions=motions,
        noises=noises,
    )

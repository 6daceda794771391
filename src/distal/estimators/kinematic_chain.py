"""Estimators of several joints without dynamics: least squares over all tendons, which are
inextensible or stretched by the force.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.directions import directions
from distal.estimators.estimator_protocol import KernelEstimator
from distal.estimators.kinematic_readings import (
    first_drives,
    levers_of,
    measured_tendons,
    read_drives,
    tension_share,
)
from distal.estimators.read_channels import Channels, channels_of
from distal.expressions import Scalar, Vector
from distal.kernels import Kernel, kernel_state_layout
from distal.model import Mechanism, solver
from distal.rig import Rig, angle_names
from distal.sensor_errors import systematic_variance, variance

ITERATIONS = 3
"""Number of Gauss–Newton steps per sample [1]: lengths are nearly linear in the angles, so that few
suffice. Source: judgement.
"""

RIDGE = 1e-9
"""Share of the mean weight that holds directions that no tendon sees where they were [1]. Source:
rounding (the matrix stays invertible).
"""

UNSEEN = np.deg2rad(3.0)
"""Least standard deviation along a direction that no tendon sees, where only springs and friction
hold the joints [rad]. Source: judgement.
"""

CONSTRAINT = 1e3
"""Factor on the tendons' stiffness where there are fewer tendons than joints, so that lengths
decide before springs do [1]. Source: judgement.
"""


def stretches(mechanism: Mechanism, pulls: Vector, elastic: bool) -> list[Scalar]:
    """Return the stretch of each tendon beyond that at its pre-tension, (T − T_pre)/k [m]; 0 if not
    `elastic`.

    The tensions balance the pull F of their drive with the smallest changes: T = T_pre + h (F − Σ h
    T_pre)/Σ h². The `pulls` are (n_drives,) [N, N m].
    """
    p = mechanism.parameters
    levers = levers_of(mechanism)
    drives = mechanism.drive_of
    lengths = []
    for i, drive in enumerate(drives):
        tendons = [j for j in range(mechanism.n_tendons) if drives[j] == drive]
        standing = sum((levers[j] * p[f"tendons.{j}.pretension"] for j in tendons), ca.SX(0))
        change = tension_share(mechanism, levers, i) * (
            pulls[drive - mechanism.n_joints] - standing
        )
        lengths.append(change / p[f"tendons.{i}.stiffness"] if elastic else ca.SX(0))
    return lengths


def unseen_covariance(rig: Rig) -> Floats:
    """Return the covariance of the angles along the directions that no tendon sees, (n_joints,
    n_joints) [rad²].

    It is the mean of the joints' initial stds, each at least `UNSEEN`, squared.
    """
    missed = directions(rig).missed
    stds = np.array(
        [max(joint.initial.std, UNSEEN) for joint in rig.joints if joint.coupled is None]
    )
    covariance: Floats = float(np.mean(stds) ** 2) * missed.T @ missed
    return covariance


def chain_function(
    mechanism: Mechanism, channels: Channels, tendons: tuple[int, ...], elastic: bool
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) whose angles fit the lengths of
    all tendons best, by least squares.

    It minimises Σ k_i (ℓ_i(θ, s) − l_i − (T_i − T_pre,i)/k_i)² over θ. With fewer tendons than
    joints many postures fit; the energy of the springs is then added, with the tendons' weight
    times `CONSTRAINT`, and selects one of them. The zero is the rig's own: θ = 0 and s = 0 at
    pre-tension.

    Args:
        mechanism: the rig's equations.
        channels: the sensors that are read.
        tendons: indices of the tendons whose drives have position sensors.
        elastic: whether tendons stretch.
    """
    nd = mechanism.n_drives
    nj = mechanism.n_joints
    free = mechanism.free
    n = nj
    width = len(channels.names)
    p = mechanism.parameters
    layout = kernel_state_layout(n, read_positions=nd, pulls=nd)
    kernel_state = ca.SX.sym("kernel_state", layout.size)
    x = ca.SX.sym("x", 1 + 2 * width)
    read_positions = layout.part(kernel_state, "read_positions")
    pulls = layout.part(kernel_state, "pulls")
    positions, filtered = read_drives(mechanism.rig, channels, read_positions, pulls, x)
    errors = [ca.SX(0)] * nd
    for sensor in channels.positions:
        drive = mechanism.rig.drive_names.index(sensor.of)
        errors[drive] = ca.SX(variance(sensor) + systematic_variance(sensor))
    desired = stretches(mechanism, filtered, elastic)
    q = ca.SX.sym("q", mechanism.n_bodies)
    lengths = mechanism.elongations(q)
    jacobian = mechanism.length_jacobian(q)
    few = len(tendons) < len(free)
    rows = list(tendons)
    look = ca.Function(
        "lengths", [q, p.symbols], [lengths[rows], jacobian[rows, :], mechanism.passive_springs(q)]
    )
    weights = ca.diag(
        ca.vertcat(*(p[f"tendons.{i}.stiffness"] * (CONSTRAINT if few else 1) for i in rows))
    )
    angles = kernel_state[:nj]
    for _ in range(ITERATIONS):
        length, slopes, springs = look(ca.vertcat(angles, positions), p.symbols)
        arms = ca.mtimes(slopes[:, :nj], mechanism.spread)
        along = ca.mtimes(arms.T, weights)
        matrix = ca.mtimes(along, arms)
        push = ca.mtimes(along, ca.vertcat(*(desired[i] for i in rows)) - length)
        if few:
            torque = springs[:, 0]
            stiffness = ca.diag(springs[:, 1])
            push += ca.mtimes(mechanism.spread.T, torque)
            matrix += ca.mtimes([mechanism.spread.T, stiffness, mechanism.spread])
        matrix += RIDGE * ca.trace(matrix) * ca.SX.eye(len(free))
        solve = solver(matrix, ca.SX.ones(len(free)))
        moved = angles[free] + solve(push)
        angles = ca.mtimes(mechanism.spread, moved) + mechanism.offsets
    gain = ca.horzcat(*(solve(along[:, k]) for k in range(len(rows))))
    bodies = [mechanism.drive_of[i] for i in rows]
    variances = ca.vertcat(
        *(slopes[k, body] ** 2 * errors[body - nj] for k, body in enumerate(bodies))
    )
    by_length = ca.mtimes(mechanism.spread, gain)
    covariance = ca.mtimes([by_length, ca.diag(variances), by_length.T]) + ca.DM(
        unseen_covariance(mechanism.rig)
    )
    following = layout.joined(
        mean=angles, covariance=covariance, read_positions=positions, pulls=filtered
    )
    outputs = [ca.cse(following), ca.SX.zeros(1)]
    return ca.Function(
        "kinematic",
        [kernel_state, x, p.symbols],
        outputs,
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


class ChainKinematics(KernelEstimator):
    """The angles of several joints from the drives' displacements and the tendons' lengths; see
    `chain_function`.

    Its standard deviation takes the errors of the position sensors into account, but not the
    stretch of the tendons (or, if `elastic`, not their friction).

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(self, name: str, rig: Rig, elastic: bool, compiled: bool = True) -> None:
        self._mechanism = Mechanism(rig)
        self._channels = channels_of(rig, name)
        tendons = measured_tendons(rig, self._channels)
        p = self._mechanism.parameters.values
        kernel = Kernel(chain_function(self._mechanism, self._channels, tendons, elastic), compiled)
        names = angle_names(rig.joint_names)
        super().__init__(name, rig, kernel, p, channels=self._channels, state_names=names)

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, variances, memory) before the first
        sample.
        """
        rig = self.rig
        channels = self._channels
        values, mask = (ca.SX.sym(name, len(channels.names)) for name in ("values", "mask"))
        memory = ca.vertcat(*first_drives(rig, channels, values, mask))
        angles, stds = (
            ca.DM([getattr(joint.initial, part) for joint in rig.joints])
            for part in ("value", "std")
        )
        return ca.Function(
            "prior", [values, mask, ca.SX.sym("p", len(self._p))], [angles, stds**2, memory]
        )

"""Estimators without dynamics: tendons are inextensible, or the measured force stretches them. Of
one joint each tendon gives an angle; of several joints, all tendons together by least squares,
with the directions of joint space that the sensors miss held by springs or by nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import null_space

from distal.arrays import Floats
from distal.estimators.estimator_protocol import Channels, KernelEstimator, channels_of
from distal.expressions import (
    Expression,
    Matrix,
    MatrixNode,
    ScalarNode,
    Vector,
    VectorNode,
    symbols,
)
from distal.kernels import Kernel, kernel_state_layout
from distal.kernels.layout import is_read
from distal.model import Mechanism, solver
from distal.rig import Rig, Sensor, angle_names, gain_of, tendon_angle_name
from distal.sensor_models import systematic_variance, variance


def symmetric(entries: Expression) -> Expression:
    """Return the symmetric matrix that has the lower triangle of `entries`, so that symmetry is
    exact.
    """
    return ca.tril2symm(ca.tril(entries))


class Downdate:
    """A covariance P that several scalar updates reduce: P − Σ g gᵀ + Σ k kᵀ.

    With g = P hᵀ/√S an update with the optimal gain K = P hᵀ/S subtracts g gᵀ. Where a state takes
    only a share κ of its gain, k kᵀ of that is added again, k = (1 − κ) g. The updates are
    collected, and `matrix` computes the sum after the last of them, so that P is read and written
    once and not once per update.
    """

    def __init__(self, covariance: MatrixNode) -> None:
        self._before = covariance
        self._gains: list[VectorNode] = []
        self._remainders: list[tuple[list[int], VectorNode]] = []

    def times(self, slope: VectorNode) -> VectorNode:
        """Return the covariance after the updates so far, times a slope hᵀ, (n,), sparse."""
        ahead = ca.mtimes(self._before, slope)
        if not slope.nnz():
            return ahead
        for gain, (at, remainder) in zip(self._gains, self._remainders):
            ahead = ca.rank1(ahead, -along(slope, gain), gain, 1)
            if slope[at].nnz():
                ahead[at] += along(slope[at], remainder) * remainder
        return ahead

    def take(self, gain: VectorNode, at: Sequence[int], shares: VectorNode) -> None:
        """Add one update with its `gain` g, (n,), which is zero where the update does not count.

        The states with the indices `at` take only the shares κ in `shares` of their gain.
        """
        self._gains.append(gain)
        self._remainders.append((list(at), gain[list(at)] * (1 - shares)))

    def matrix(self) -> MatrixNode:
        """Return the covariance after all updates.

        It is exactly symmetric: products of the same two numbers are added in the same order on
        both sides.
        """
        if not self._gains:
            return self._before
        gains = ca.horzcat(*self._gains)
        after = ca.mac(gains, -gains.T, self._before)
        for at in dict.fromkeys(tuple(at) for at, _ in self._remainders if at):
            remainders = ca.horzcat(
                *(remainder for rows, remainder in self._remainders if tuple(rows) == at)
            )
            after[list(at), list(at)] += ca.mtimes(remainders, remainders.T)
        return after


def along(slope: VectorNode, values: VectorNode) -> ScalarNode:
    """Return the scalar product of a slope, (n,), sparse, and a vector, (n,)."""
    return ca.mtimes(slope.T, values) if slope.nnz() else ca.MX(0)


SMALLEST = 1e-3
"""A direction along which tendons move by less than this share of the strongest one's motion counts
as missed [1]. Source: judgement.
"""


@dataclass(frozen=True)
class Directions:
    """Directions of joint space at a posture that the sensors miss.

    Args:
        missed: orthonormal directions, (m, n), along which no measured tendon moves.
        sprung: whether springs hold all missed directions.
    """

    missed: Floats
    sprung: bool

    @property
    def text(self) -> str:
        """A sentence on what is not seen."""
        held = (
            "springs hold them, as long as nothing touches the joints"
            if self.sprung
            else "the bands say how far"
        )
        return f"the sensors miss {len(self.missed)} of the joints' directions: {held}"


def directions(rig: Rig) -> Directions:
    """Return which directions of joint space the sensors of a rig miss at the joints' `initial`
    angles.

    A tendon tells ∂ℓ/∂θ · δθ if its drive has a position sensor or its own tension is measured.
    Directions orthogonal to all these rows are missed (singular values below `SMALLEST` of the
    largest). A coupled joint moves with the joint that it is coupled to.
    """
    mechanism = Mechanism(rig)
    q = ca.SX.sym("q", mechanism.n_bodies)
    p = mechanism.parameters
    look = ca.Function(
        "arms", [q, p.symbols], [mechanism.length_jacobian(q), mechanism.passive_springs(q)[:, 1]]
    )
    at = [*(joint.initial.value for joint in rig.joints), *np.zeros(mechanism.n_drives)]
    jacobian, springs = (np.array(part) for part in look(at, p.values))
    placed = {sensor.of for sensor in rig.sensors_of("position")}
    measured = {sensor.of for sensor in rig.sensors_of("tension")}
    rows = [
        i
        for i, tendon in enumerate(rig.tendons)
        if tendon.drive in placed or tendon.name in measured
    ]
    spread = mechanism.spread.full()
    across = null_space(-jacobian[rows, : mechanism.n_joints] @ spread, rcond=SMALLEST)
    missed = (spread @ across).T
    missed = missed / np.maximum(np.linalg.norm(missed, axis=1, keepdims=True), 1e-300)
    stiffness = spread.T @ np.diag(springs.ravel()) @ spread
    held = np.linalg.eigvalsh(across.T @ stiffness @ across)
    return Directions(missed, bool(np.all(held > 0.0)))


CUT_OFF = 5.0
"""Cut-off frequency of the low-pass on measured forces in `elastic` [Hz]. Source: judgement."""


def read_drives(
    rig: Rig, channels: Channels, positions: Vector, pulls: Vector, x: Vector
) -> tuple[Vector, Vector]:
    """Return positions and low-passed pulls of the drives after a sample, (n_drives,) each.

    The low-pass is F⁺ = U + e^{−2π f dt} (F − U), f = `CUT_OFF`, of the measured pull U.

    Args:
        channels: the sensors that are read.
        positions: before the sample [m, rad], (n_drives,).
        pulls: F before the sample [N, N m], (n_drives,).
        x: the sample (dt, values, mask).
    """
    names = rig.drive_names
    dt, values, mask = channels.row.parts(x).values()
    forget = ca.exp(-2 * ca.pi * CUT_OFF * dt)
    held = ca.vertsplit(positions)
    filtered = ca.vertsplit(pulls)
    for sensor in (*channels.positions, *channels.forces):
        i = names.index(sensor.of)
        j = channels.names.index(sensor.name)
        read = (values[j] - sensor.bias.value) / gain_of(sensor).value
        if sensor in channels.positions:
            held[i] = ca.if_else(is_read(mask[j]), read, positions[i])
        else:
            after = read + forget * (pulls[i] - read)
            filtered[i] = ca.if_else(is_read(mask[j]), after, pulls[i])
    return ca.vertcat(*held), ca.vertcat(*filtered)


def first_drives(
    rig: Rig, channels: Channels, values: Vector, mask: Vector
) -> tuple[Vector, Vector]:
    """Return positions and pulls of the drives at the first sample, (n_drives,) each.

    Where nothing is read, a position is 0 and a pull is the nominal one. The sample's `values` and
    `mask` are (n_channels,).
    """
    nominal = ca.SX(ca.DM([drive.nominal_force.value for drive in rig.drives]))
    still = ca.SX.zeros(len(rig.drives))
    return read_drives(rig, channels, still, nominal, ca.vertcat(ca.inf, values, mask))


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


def error_of(sensor: Sensor) -> float:
    """Return the variance of a sensor's errors, as if all were random from sample to sample."""
    return variance(sensor) + systematic_variance(sensor)


class KinematicEstimator(KernelEstimator):
    """The angles of the joints from the drives' displacements and the tendons' lengths.

    Of one joint a tendon whose drive has a position sensor gives the angle at which its length fits
    the drive's displacement: ℓ − l = e_0 + s, with its stretch s of `_stretches`. The joint's angle
    is the mean over these tendons. e_0 is ℓ − l − s at the first sample, with the joint at its
    `initial` angle. Of several joints, see `_fitted`.

    Its standard deviation takes the errors of the position sensors and, of one joint, of the
    initial angle into account, but not the stretch of the tendons (or, if `elastic`, not their
    friction).

    Args:
        name: of the estimator.
        rig: the description.
        elastic: whether tendons stretch.
        compiled: whether the kernel is compiled where possible.

    Raises:
        EstimationError: the sensors do not suffice.
    """

    def __init__(self, name: str, rig: Rig, elastic: bool, compiled: bool = True) -> None:
        self._mechanism = Mechanism(rig)
        self._channels = channels_of(rig, name)
        drives = [sensor.of for sensor in self._channels.positions]
        self._tendons = [i for i, tendon in enumerate(rig.tendons) if tendon.drive in drives]
        self._elastic = elastic
        self._alone = len(rig.joints) == 1
        kernel = Kernel(self._function(), compiled)
        names = angle_names(rig.joint_names)
        if self._alone:
            names = (*names, *(tendon_angle_name(rig.tendons[i].name) for i in self._tendons))
        p = self._mechanism.parameters.values
        super().__init__(name, rig, kernel, p, channels=self._channels, state_names=names)

    def _function(self) -> ca.Function:
        """Return the function (kernel_state, x, p) → (kernel_state⁺, y)."""
        mechanism = self._mechanism
        nd = mechanism.n_drives
        k = len(self._tendons) if self._alone else 0
        layout = kernel_state_layout(mechanism.n_joints + k, lengths=k, positions=nd, pulls=nd)
        inputs = symbols(ca.SX, kernel_state=layout.size, x=self._channels.row.size)
        kernel_state, x = inputs
        was = layout.parts(kernel_state)
        positions, pulls = read_drives(
            mechanism.rig, self._channels, was["positions"], was["pulls"], x
        )
        stretched = self._stretches(pulls)
        if self._alone:
            q = ca.vertcat(was["mean"][0], positions)
            angles = [
                mechanism.angle_at(tendon, was["lengths"][row] + stretched[row], q)
                for row, tendon in enumerate(self._tendons)
            ]
            mean = ca.vertcat(sum(angles) / len(angles), *angles)
            covariance = was["covariance"]
        else:
            mean, covariance = self._fitted(was["mean"], positions, stretched)
        following = layout.joined(
            mean=mean,
            covariance=covariance,
            lengths=was["lengths"],
            positions=positions,
            pulls=pulls,
        )
        arguments = [*inputs, mechanism.parameters.symbols]
        return ca.Function("kinematic", arguments, [ca.cse(following), ca.SX.zeros(1)])

    def _stretches(self, pulls: Vector) -> Vector:
        """Return the stretch of each measured tendon beyond that at its pre-tension, (T − T_pre)/k,
        (n_tendons,) [m]; 0 if not `elastic`.

        The tensions balance the pull F of their drive with the smallest changes: T = T_pre + h (F −
        Σ h T_pre)/Σ h². The `pulls` are (n_drives,) [N, N m].
        """
        if not self._elastic:
            return ca.SX.zeros(len(self._tendons))
        mechanism = self._mechanism
        p = mechanism.parameters
        # h, a tendon's displacement per one of its drive: 1 for a slider, side · R for a capstan
        levers = [mechanism.winds(i) * mechanism.lever(d) for i, d in enumerate(mechanism.drive_of)]
        lengths = []
        for i in self._tendons:
            drive = mechanism.drive_of[i]
            tendons = mechanism.pulled_by(drive)
            standing = sum((levers[j] * p[f"tendons.{j}.pretension"] for j in tendons), ca.SX(0))
            square = sum((levers[j] ** 2 for j in tendons), ca.SX(0))
            change = levers[i] / square * (pulls[drive - mechanism.n_joints] - standing)
            lengths.append(change / p[f"tendons.{i}.stiffness"])
        return ca.vertcat(*lengths)

    def _fitted(self, angles: Vector, positions: Vector, desired: Vector) -> tuple[Vector, Matrix]:
        """Return the angles of several joints that fit the lengths of all measured tendons best, by
        least squares, and their covariance.

        They minimise Σ k_i (ℓ_i(θ, s) − l_i − (T_i − T_pre,i)/k_i)² over θ. With fewer tendons than
        joints many postures fit; the energy of the springs is then added, with the tendons' weight
        times `CONSTRAINT`, and selects one of them. The zero is the rig's own: θ = 0 and s = 0 at
        pre-tension.

        Args:
            angles: at which the search begins, (n_joints,).
            positions: of the drives, (n_drives,).
            desired: stretch of each tendon, (n_tendons,).
        """
        mechanism = self._mechanism
        nj = mechanism.n_joints
        free = mechanism.free
        spread = mechanism.spread
        p = mechanism.parameters
        q = ca.SX.sym("q", mechanism.n_bodies)
        rows = self._tendons
        few = len(rows) < len(free)
        lengths = mechanism.elongations(q)[rows]
        look = ca.Function(
            "lengths",
            [q, p.symbols],
            [lengths, mechanism.length_jacobian(q)[rows, :], mechanism.passive_springs(q)],
        )
        weights = ca.diag(
            ca.vertcat(*(p[f"tendons.{i}.stiffness"] * (CONSTRAINT if few else 1) for i in rows))
        )
        for _ in range(ITERATIONS):
            length, slopes, springs = look(ca.vertcat(angles, positions), p.symbols)
            arms = ca.mtimes(slopes[:, :nj], spread)
            along = ca.mtimes(arms.T, weights)
            matrix = ca.mtimes(along, arms)
            push = ca.mtimes(along, desired - length)
            if few:
                push += ca.mtimes(spread.T, springs[:, 0])
                matrix += ca.mtimes([spread.T, ca.diag(springs[:, 1]), spread])
            matrix += RIDGE * ca.trace(matrix) * ca.SX.eye(len(free))
            solve = solver(matrix, ca.SX.ones(len(free)))
            angles = ca.mtimes(spread, angles[free] + solve(push)) + mechanism.offsets
        columns = (solve(column) for column in ca.horzsplit(along))
        by_length = ca.mtimes(spread, ca.horzcat(*columns))
        variances = [
            slopes[k, mechanism.drive_of[i]] ** 2 * self._error(i) for k, i in enumerate(rows)
        ]
        covariance = ca.mtimes([by_length, ca.diag(ca.vertcat(*variances)), by_length.T])
        return angles, covariance + ca.DM(unseen_covariance(mechanism.rig))

    def _error(self, tendon: int) -> float:
        """Return the variance of the errors of the position of a tendon's drive."""
        part = self._mechanism.rig.tendons[tendon]
        return next(error_of(s) for s in self._channels.positions if s.of == part.drive)

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance or variances, memory) before
        the first sample.
        """
        values, mask, _ = self._first_sample()
        positions, pulls = first_drives(self.rig, self._channels, values, mask)
        angles, stds = (
            ca.DM([getattr(joint.initial, part) for joint in self.rig.joints])
            for part in ("value", "std")
        )
        drives = ca.vertcat(positions, pulls)
        prior = angles, stds**2, drives
        if self._alone:
            q = ca.vertcat(angles, positions)
            lengths = self._mechanism.elongations(q)[self._tendons] - self._stretches(pulls)
            mean = ca.SX.ones(1 + len(self._tendons)) * angles
            prior = mean, self._first_covariance(q) + stds**2, ca.vertcat(lengths, drives)
        p = self._mechanism.parameters.symbols
        return ca.Function("prior", [values, mask, p], [ca.densify(ca.SX(part)) for part in prior])

    def _first_covariance(self, q: Vector) -> Matrix:
        """Return the covariance of the mean and the tendons' angles at q by the errors of the
        position sensors.

        All tendons have the same zero, whose error they share; a sensor errs twice, at the first
        sample and at the current one.
        """
        jacobian = self._mechanism.length_jacobian(q)
        variances = []
        for i in self._tendons:
            slope = jacobian[i, self._mechanism.drive_of[i]] / jacobian[i, 0]
            variances.append(slope**2 * 2.0 * self._error(i))
        k = len(variances)
        mixing = ca.vertcat(ca.DM.ones(1, k) / k, ca.DM.eye(k))
        return ca.mtimes([mixing, ca.diag(ca.vertcat(*variances)), mixing.T])

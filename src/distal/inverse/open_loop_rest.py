"""Angles at which joints come to rest with the drives' positions that are really sent, and their
variances: the band of an open loop.

Joints rest where friction l holds the residual torque r, |r(θ, s, p)| ≤ l, at the drives' positions
s. At the desired angles r is zero, unless a drive is cut at the end of its range, at its force
limit or at its speed limit. Then Newton's steps find θ, from the angles of the sample before and
within the stops: far from there the geometry of a tendon has other solutions.

Since r(θ, s, p) = 0 there, dθ/dp = −(∂r/∂θ)⁻¹ ∂r/∂p. The parameters p have the stds of the rig
file, and the positions those of their sensors. A joint whose friction has not turned over may rest
anywhere within the friction limit l of that.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Matrix, Vector
from distal.inverse.feedforward import KERNEL, STEPS, CommandModel
from distal.inverse.pid import limited
from distal.inverse.tension_distribution import solved
from distal.inverse.torque_balance import traced
from distal.kernels import Layout
from distal.rig import Rig

LARGEST_TURN = float(np.deg2rad(2.0))
"""Largest turn of a joint in one of Newton's steps; within it, a joint that was left behind counts
as back at its desired angle [rad]. Source: judgement.
"""

SOFTEST = 1e-9
"""Stiffness that is added to every joint, so that a joint which nothing holds has a wide but finite
band [N m/rad]. Source: rounding (division by a stiffness of zero).
"""


class RestModel(CommandModel):
    """The inverse of a rig, with the angles at which its joints rest as a second kernel."""

    @cached_property
    def rest_x(self) -> Layout:
        """Layout of a sample of that kernel: desired angles, drives' positions and their variances,
        the directions of friction, the internal state, and whether a drive is cut.
        """
        return Layout(
            angles=self.nf,
            positions=self.nd,
            variances=self.nd,
            turned=self.nf,
            inside=self.n_inside,
            cut=1,
        )

    def rest_function(self) -> ca.Function:
        """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of the angles at which free
        joints rest and their variances, y = (θ_free [rad], σ² [rad²]), (2 n_free,).

        The kernel state is (θ_free, whether joints were left behind). As long as they were not,
        θ_free are the desired angles.
        """
        kernel_state = ca.MX.sym("kernel_state", self.nf + 1)
        x = ca.MX.sym("x", self.rest_x.size)
        p = ca.MX.sym("p", self.n_parameters)
        came = self.rest_x.parts(x)
        parameters = ca.vertcat(p, came["inside"])
        angles, was_behind = ca.vertsplit(kernel_state, [0, self.nf, self.nf + 1])
        for _ in range(STEPS):
            step = self._step(angles, came["positions"], parameters)
            angles = self.within_stops(angles + step, parameters)
        away = ca.fabs(angles - came["angles"]) > LARGEST_TURN
        stays = ca.logic_and(was_behind > 0, ca.dot(away, away) > 0)
        behind = ca.logic_or(came["cut"] > 0, stays)
        angles = ca.if_else(behind, angles, came["angles"])
        # friction may act either way where a drive is cut
        turned = came["turned"] * (1 - came["cut"])
        spread = self._spread(angles, came["positions"], turned, came["variances"], parameters)
        following = ca.vertcat(angles, behind)
        return ca.Function(
            "rest", [kernel_state, x, p], [following, ca.vertcat(angles, spread)], *KERNEL
        )

    @traced
    def _step(self, free: Vector, positions: Vector, p: Vector) -> list[Vector]:
        """Function (θ_free, s, p) → Newton's step towards rest; a joint whose residual torque
        friction holds stays.
        """
        lacks, friction = self.lacking(free, positions, ca.SX.zeros(self.nf))
        beyond = lacks - limited(lacks, friction)
        return [limited(-solved(self._slopes(lacks, free), beyond), LARGEST_TURN)]

    def _slopes(self, lacks: Vector, free: Vector) -> Matrix:
        """Return the derivatives of the residual torques by the angles."""
        return ca.jacobian(lacks, free) - SOFTEST * ca.SX.eye(self.nf)

    @traced
    def _spread(
        self, free: Vector, positions: Vector, turned: Vector, variances: Vector, p: Vector
    ) -> list[Vector]:
        """Function (θ_free, s, d, σ_s², p) → variances of θ_free [rad²].

        They follow from the stds of the rig's parameters, from the variances σ_s² of the drives'
        positions, and from friction that has not turned over, by its directions d.
        """
        lacks, friction = self.lacking(free, positions, turned)
        slopes = self._slopes(lacks, free)
        by_positions = ca.mtimes(ca.jacobian(lacks, positions), ca.diag(ca.sqrt(variances)))
        # all torques within friction that has not turned over are equally likely: the variance is a
        # third of its square
        left = ca.sqrt(friction**2 * ca.fmax(1 - turned**2, 0) / 3)
        errors = ca.horzcat(self._by_parameters(lacks), by_positions, ca.diag(left))
        columns = ca.horzsplit(ca.densify(errors))
        return [sum((solved(slopes, column) ** 2 for column in columns), ca.SX.zeros(self.nf))]

    def _by_parameters(self, lacks: Vector) -> Matrix:
        """Return how residual torques change with the parameters, (n_free, k): a column for one std
        of each parameter's own error, and one for that of each error that several share.
        """
        parameters = self.mechanism.parameters
        p = parameters.symbols
        slopes = ca.jacobian(lacks, p)
        columns = [
            slopes[:, i] * self.number(p, [f"{parameters.names[i]}.std"])
            for i in np.flatnonzero(parameters.independent_stds > 0.0).tolist()
        ]
        columns += [
            ca.mtimes(slopes[:, members], p[members]) * self.number(p, [f"shared.{name}.std"])
            for name, (_, members) in parameters.shared.items()
        ]
        return ca.horzcat(ca.SX(self.nf, 0), *columns)


def position_variances(rig: Rig) -> Floats:
    """Return the variances of the drives' positions by the zeros and the linearity of their
    sensors, (n_drives,) [m², rad²].
    """
    sensors = {sensor.of: sensor for sensor in rig.sensors_of("position")}
    found = [sensors.get(drive.name) for drive in rig.drives]
    # the largest error by a curve counts as two standard deviations, as in the filter
    return np.array(
        [0.0 if one is None else one.bias.total_std**2 + (one.linearity / 2) ** 2 for one in found]
    )

"""One sample of the inverse: from desired angles to the setpoints of the drives.

The torques τ that the joints need (`Balance`) give the pulls f with A f = τ (`distribution`). Each
drive goes to the position s at which its tendons pull so by the model, T(θ, s) = f. Since T grows
with s, Newton's steps within a bracket find it. The internal state (backlash, points of sheaths,
creep) is kept from sample to sample and follows the commands.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from distal.inverse.balance import Balance
from distal.inverse.distribution import Prefer, least_pulls, solved
from distal.kernels import Layout
from distal.rig import Rig

TURNS = float(np.deg2rad(0.1))
"""Turn of a joint over which the direction of its friction changes by 1 [rad]. Source: judgement.
"""

DRIVE_TURNS = 0.1e-3
"""Motion of a drive along its tendon over which the direction of its friction changes by 1 [m].
Source: judgement.
"""

ROUNDS = 3
"""Number of rounds in which friction follows from tensions and tensions from friction. Source:
judgement.
"""

NEWTON_STEPS = 14
"""Number of steps to a drive's position: Newton's, or halvings of the bracket where a tendon is
slack or in its backlash. Source: judgement.
"""

FARTHEST = 0.1
"""Largest distance along its tendon, from where a drive is, at which its next position is looked
for [m]. Source: judgement.
"""

FLATTEST = 1e-6
"""Slope of a pull, as a share of the tendons' stiffness, up to which it counts as zero [1]. Source:
rounding (division by a slope of zero).
"""

TINY_PULL = 1e-9
"""Least friction in a transmission that is divided by [N]. Source: rounding (division by a friction
of zero).
"""

REACHES = 8
"""Number of Gauss-Newton steps to the nearest angles that can be held, where drives are fewer than
joints. Source: judgement.
"""


class CommandModel(Balance):
    """The inverse of a rig as a kernel: its function, and the layouts of its kernel state, of a
    desired sample and of its output.
    """

    def __init__(self, rig: Rig, prefer: Prefer = "tension", folded: bool = False) -> None:
        super().__init__(rig, folded)
        self.prefer = prefer
        self.rubbing = [d for d, drive in enumerate(rig.drives) if drive.hysteresis is not None]
        inside = len(self.mechanism.plays) + len(self.mechanism.strains)
        self.kernel_state = Layout(
            positions=self.nd,
            pulls=self.nd,
            turned=self.nf,
            drives_turned=self.nd,
            rubbed=self.nd,
            inside=inside,
            begun=1,
        )
        self.x = Layout(
            dt=1, angles=self.nf, speeds=self.nf, accelerations=self.nf, torques=self.nj, lowest=1
        )
        self.y = Layout(
            angles=self.nf,
            positions=self.nd,
            speeds=self.nd,
            forces=self.nd,
            tensions=self.nt,
            friction=self.nf,
            short=self.nd,
        )

    def function(self) -> ca.Function:
        """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of the next command, with the
        parameters p without the internal state.
        """
        kernel_state = ca.MX.sym("kernel_state", self.kernel_state.size)
        x = ca.MX.sym("x", self.x.size)
        inside_count = self.kernel_state["inside"].stop - self.kernel_state["inside"].start
        p = ca.MX.sym("p", self.mechanism.parameters.symbols.numel() - inside_count)
        was = self.kernel_state.parts(kernel_state)
        desired = self.x.parts(x)
        parameters = ca.vertcat(p, was["inside"]) if inside_count else p
        step = self._sample()
        out = step(
            *(was[name] for name in was if name != "inside"),
            *(desired[name] for name in desired),
            parameters,
        )
        named = dict(zip(step.name_out(), out))
        bodies = ca.vertcat(named.pop("joints"), named["positions"])
        inside = self.moved(bodies, desired["dt"], parameters) if inside_count else ca.MX(0, 1)
        after = self.kernel_state.joined(
            **{
                name: named[name]
                for name in self.kernel_state.names
                if name not in ("inside", "begun")
            },
            inside=inside,
            begun=ca.MX(1),
        )
        # a drive goes no further than its range; its force is still that of the desired position
        named["positions"] = named.pop("within")
        y = self.y.joined(**{name: named[name] for name in self.y.names})
        return ca.Function(
            "command", [kernel_state, x, p], [after, y], ["kernel_state", "x", "p"], ["next", "y"]
        )

    def _sample(self) -> ca.Function:
        """Return the function of one sample: of the parts of the kernel state without the internal
        state, the parts of the desired sample, and all parameters.
        """
        nf = self.nf
        nd = self.nd
        positions, pulls, drives_turned, rubbed = (
            ca.MX.sym(n, nd) for n in ("positions", "pulls", "drives_turned", "rubbed")
        )
        turned = ca.MX.sym("turned", nf)
        begun = ca.MX.sym("begun")
        dt = ca.MX.sym("dt")
        lowest = ca.MX.sym("lowest")
        angles, speeds, accelerations = (
            ca.MX.sym(n, nf) for n in ("angles", "speeds", "accelerations")
        )
        external = ca.MX.sym("external", self.nj)
        p = ca.MX.sym("p", self.mechanism.parameters.symbols.numel())
        turning = ca.fmin(ca.fmax(turned + speeds * dt / TURNS, -1), 1)
        held = angles
        s = positions
        f = pulls
        most = self.of_drives(p, "most_pull")
        for _ in range(ROUNDS):
            if any(len(part.drives) < len(part.joints) for part in self.parts):
                held, f = self._reached()(angles, held, f, s, turning, external, lowest, p)
            torques, friction = self.needed(held, speeds, accelerations, s, turning, external, p)
            joints = self.spread()(held)
            arms, shares, steepest = self.geometry(joints, s, p)
            asked = self._pulls()(arms, torques, lowest * self.of_drives(p, "margin"), f)
            f = ca.fmin(ca.fmax(asked, -most), most)
            sprung = f
            rubbing = rubbed
            if self.rubbing:
                sprung, rubbing = self._internal()(joints, s, f, pulls, rubbed, p)
            s = self._positions()(joints, s, sprung, shares, steepest, p)
        rates = ca.if_else(begun > 0, (s - positions) / ca.if_else(dt > 0, dt, 1), 0)
        along = self.of_drives(p, "radius")
        drives_turning = ca.fmin(
            ca.fmax(drives_turned + begun * along * (s - positions) / DRIVE_TURNS, -1), 1
        )
        within = ca.fmin(ca.fmax(s, self.of_drives(p, "low")), self.of_drives(p, "high"))
        forces, tensions = self.driven(joints, s, within, rates, drives_turning, p)
        names = ("positions", "pulls", "drives_turned", "rubbed", "turned", "begun")
        before = dict(zip(names, (positions, pulls, drives_turned, rubbed, turned, begun)))
        arguments = [before[name] for name in self.kernel_state.names if name != "inside"]
        arguments += [dt, angles, speeds, accelerations, external, lowest, p]
        outputs = {
            "joints": joints,
            "angles": held,
            "positions": s,
            "within": within,
            "speeds": rates,
            "forces": forces,
            "tensions": tensions,
            "friction": friction,
            "short": asked - f,
            "pulls": f,
            "turned": turning,
            "drives_turned": drives_turning,
            "rubbed": rubbing,
        }
        named = [f"i{k}" for k in range(len(arguments))]
        return ca.Function("sample", arguments, list(outputs.values()), named, list(outputs))

    def _pulls(self) -> ca.Function:
        """Return the function (arms, τ, least, f) → pulls of the drives, not below `least` for
        one-sided ones. Where drives are fewer than the joints that they move, f stays.
        """
        arms = ca.SX.sym("arms", self.nf, self.nd)
        torques = ca.SX.sym("torques", self.nf)
        least = ca.SX.sym("least", self.nd)
        before = ca.SX.sym("before", self.nd)
        pulls = ca.SX(before)
        one_sided = self.one_sided
        for part in self.parts:
            joints = list(part.joints)
            drives = list(part.drives)
            if len(drives) >= len(joints):
                sided = [one_sided[d] for d in drives]
                block = ca.SX(len(joints), len(drives))
                pattern = self._pattern(joints, drives)
                for r, c in pattern:
                    block[r, c] = arms[joints[r], drives[c]]
                found = least_pulls(block, torques[joints], least[drives], sided, self.prefer)
                for d, is_sided, pull in zip(drives, sided, ca.vertsplit(found)):
                    pulls[d] = ca.fmax(pull, least[d]) if is_sided else pull
        return ca.Function("pulls", [arms, torques, least, before], [ca.cse(ca.densify(pulls))])

    def _pattern(self, joints: Sequence[int], drives: Sequence[int]) -> list[tuple[int, int]]:
        symbols = (
            ca.SX.sym("q", self.nj),
            ca.SX.sym("s", self.nd),
            self.mechanism.parameters.symbols,
        )
        arms = ca.sparsify(self.arms(*symbols))[list(joints), list(drives)]
        return [(int(r), int(c)) for r, c in zip(*arms.sparsity().get_triplet())]

    def _reached(self) -> ca.Function:
        """Return the function (desired, θ, f, s, d, τ_ext, lowest, p) → the nearest angles that
        pulls can hold, and these pulls.

        At θ and f the residual torque of the joints is r = A f − τ; after a change df of the pulls
        they rest at θ − (∂r/∂θ)⁻¹ (r + A df).
        """
        nf = self.nf
        nd = self.nd
        desired, angles, turned = (ca.SX.sym(n, nf) for n in ("desired", "angles", "turned"))
        pulls = ca.SX.sym("pulls", nd)
        positions = ca.SX.sym("positions", nd)
        external = ca.SX.sym("tau", self.nj)
        lowest = ca.SX.sym("lowest")
        p = self.mechanism.parameters.symbols
        held = ca.SX(angles)
        f = ca.SX(pulls)
        for _ in range(REACHES):
            lacking, slopes = self.tangent(held, f, positions, turned, external, p)
            arms = self.arms(self.all_joints(held), positions, p)
            for part in self.parts:
                joints = list(part.joints)
                drives = list(part.drives)
                if len(drives) >= len(joints):
                    continue
                own = slopes[joints, joints]
                rest = held[joints] - solved(own, lacking[joints])
                moves = -ca.horzcat(*(solved(own, arms[joints, d]) for d in drives))
                away = desired[joints] - rest
                change = solved(ca.mtimes(moves.T, moves), ca.mtimes(moves.T, away))
                after = ca.fmax(f[drives] + change, lowest)
                held[joints] = rest + ca.mtimes(moves, after - f[drives])
                f[drives] = after
        arguments = [desired, angles, pulls, positions, turned, external, lowest, p]
        return ca.Function("reached", arguments, ca.cse([ca.densify(held), ca.densify(f)]))

    def _positions(self) -> ca.Function:
        """Return the function (θ, s, f, shares, steepest, p) → positions at which the drives pull
        with f.
        """
        nd = self.nd
        angles = ca.MX.sym("angles", self.nj)
        before = ca.MX.sym("before", nd)
        pulls = ca.MX.sym("pulls", nd)
        shares = ca.MX.sym("shares", self.nt)
        steepest = ca.MX.sym("steepest", nd)
        p = ca.MX.sym("p", self.mechanism.parameters.symbols.numel())
        rising = ca.DM([self.winds(d) for d in range(nd)])
        s = before
        wide = FARTHEST / self.of_drives(p, "radius")
        low = before - wide
        high = before + wide
        refine = self._refine()
        for _ in range(NEWTON_STEPS):
            value, slope = self.pull(angles, s, shares, p)
            s, low, high = refine(s, low, high, rising * (value - pulls), rising * slope, steepest)
        return ca.Function("positions", [angles, before, pulls, shares, steepest, p], [s])

    def _internal(self) -> ca.Function:
        """Return the function (θ, s, f, f before, e, p) → pulls that are left for the springs, and
        e⁺, after friction in the transmissions (`Hysteresis`).

        This friction is e h, with e in [−1, 1] that turns over as the pull changes by h: f_spring =
        f − e h.
        """
        angles = ca.SX.sym("angles", self.nj)
        positions = ca.SX.sym("positions", self.nd)
        pulls, before, rubbed = (ca.SX.sym(name, self.nd) for name in ("pulls", "before", "rubbed"))
        mechanism = self.mechanism
        sprung = ca.SX(pulls)
        after = ca.SX(rubbed)
        q = ca.vertcat(angles, positions)
        tensions = mechanism.tensions(q, ca.SX.zeros(mechanism.n_bodies))
        for d in self.rubbing:
            radius = self.number(mechanism.parameters.symbols, [f"drives.{d}.radius"])
            limit = mechanism.hysteresis_limit(d, q, tensions) / radius
            turned = (pulls[d] - before[d]) / ca.fmax(limit, TINY_PULL)
            after[d] = ca.fmin(ca.fmax(rubbed[d] + turned, -1), 1)
            sprung[d] -= after[d] * limit
        arguments = [angles, positions, pulls, before, rubbed, mechanism.parameters.symbols]
        return ca.Function("internal", arguments, ca.cse([ca.densify(sprung), ca.densify(after)]))

    def _refine(self) -> ca.Function:
        """Return the function (s, low, high, excess, slope, steepest) → next s, low and high, by
        Newton's step, or to the middle of the bracket.
        """
        names = ("s", "low", "high", "excess", "slope", "steepest")
        s, low, high, excess, slope, steepest = (ca.SX.sym(name, self.nd) for name in names)
        below = excess < 0
        lower = ca.if_else(below, s, low)
        upper = ca.if_else(below, high, s)
        usable = slope > FLATTEST * steepest
        newton = s - excess / ca.if_else(usable, slope, 1)
        inner = ca.logic_and(usable, ca.logic_and(newton >= lower, newton <= upper))
        middle = (lower + upper) / 2
        arguments = [s, low, high, excess, slope, steepest]
        return ca.Function("refine", arguments, [ca.if_else(inner, newton, middle), lower, upper])

"""One sample of the inverse: from desired angles to what the drives do.

Of the torques that the joints need (`Balance`) follow pulls f with A f = τ (`distribution`), and
each drive goes to the position s at which its tendons pull so: T(θ, s) of the model, solved by
Newton's steps within a bracket, since T grows with s. What moves inside (plays, points of sheaths,
creep) is remembered and goes on with the commands.
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
"""A joint's friction has turned over after so much motion [rad]."""

DRIVE_TURNS = 0.1e-3
"""The same of a drive, along its tendon [m]."""

ROUNDS = 3
"""Friction depends on tensions, and these on friction: so often one follows from the other."""

NEWTON_STEPS = 14
"""Steps to a drive's position: halving the bracket where a tendon is slack or a play is open,
Newton's elsewhere.
"""

FARTHEST = 0.1
"""A drive's position is looked for within so much along its tendon from where it is [m]."""

FLATTEST = 1e-6
"""A slope below this share of the tendons' stiffness counts as none."""

TINY_PULL = 1e-9
"""Least friction inside a transmission that is divided by [N]."""

REACHES = 8
"""Gauss-Newton steps to the nearest angles that fewer drives than joints can hold."""


class CommandModel(Balance):
    """The inverse of a rig as a kernel: layouts of its kernel state, its desired sample and its
    output, and the function.
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
        """Return (kernel_state, x, p) → (kernel_state⁺, y): the next command; p are the rig's
        numbers without what moves inside.
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
        # where a drive's range ends, it goes no further; what it would have to pull is still its
        # force
        named["positions"] = named.pop("within")
        y = self.y.joined(**{name: named[name] for name in self.y.names})
        return ca.Function(
            "command", [kernel_state, x, p], [after, y], ["kernel_state", "x", "p"], ["next", "y"]
        )

    def _sample(self) -> ca.Function:
        """Return one sample as a function of the kernel state's parts, the desired sample's, and
        all numbers.
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
        """Return (arms, τ, least, f) → pulls, no less than the `least` of each drive where there
        are enough of them; those of fewer stay.
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
        """Return (desired, θ, f, s, d, τ_ext, lowest, p) → the nearest angles that pulls can hold,
        and these pulls.

        At θ, f the joints lack r = A f − τ: after a change of the pulls they come to rest at θ −
        (∂r/∂θ)⁻¹ (r + A df).
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
        """Return (θ, s, f, shares, steepest, p) → positions at which the drives pull f."""
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
        """Return (θ, s, f, f before, e, p) → what is left for the springs, e⁺: friction in
        transmissions (`Hysteresis`).

        It is e h, with e in [−1, 1] that turns over as the pull changes by h: f_spring = f − e h.
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
        """Return (s, low, high, excess, slope, steepest) → the next of each: Newton's step, or the
        bracket's middle.
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

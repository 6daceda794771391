"""One sample of the inverse: from wanted angles to what the drives do, by the equations of `Mechanism`.

At wanted θ, ω and α a joint needs  τ = M α + b ω − passive(θ) + d l(T) − τ_ext  from its tendons, with the friction limit l
in the direction of motion d. Pulls f with A f = τ are chosen (`distribution`), and each drive goes to the place s at which
its tendons pull so: T(θ, s) of the model, solved by Newton's steps within a bracket, since T grows with s. What moves
inside (plays, points of sheaths, creep) is remembered and goes on with the commands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from distal.expressions import Matrix, Vector
from distal.inverse.distribution import least_pulls, solved
from distal.kernels import Layout
from distal.model import Mechanism
from distal.rig import Rig

TURNS = float(np.deg2rad(0.1))
"""A joint's friction has turned over after so much motion [rad]."""

DRIVE_TURNS = 0.1e-3
"""The same of a drive, along its tendon [m]."""

ROUNDS = 3
"""Friction depends on tensions, and these on friction: so often one follows from the other."""

NEWTON_STEPS = 14
"""Steps to a drive's place: halving the bracket where a tendon is slack or a play is open, Newton's elsewhere."""

FARTHEST = 0.1
"""A drive's place is looked for within so much along its tendon from where it is [m]."""

FLATTEST = 1e-6
"""A slope below this share of the tendons' stiffness counts as none."""

TINY_PULL = 1e-9
"""Least friction inside a transmission that is divided by [N]."""

REACHES = 8
"""Gauss-Newton steps to the nearest angles that fewer drives than joints can hold."""


@dataclass(frozen=True)
class Part:
    """Joints that move by themselves and the drives that move them, together with no others: indices of both."""

    joints: tuple[int, ...]
    drives: tuple[int, ...]


class CommandModel:
    """The expressions of the inverse of a rig: layouts of its carry, its wanted sample and its output, and the function."""

    def __init__(self, rig: Rig) -> None:
        self.mechanism = mechanism = Mechanism(rig, remembers=True)
        self.rig, self.free = rig, list(mechanism.free)
        self.nj, self.nd, self.nt, self.nf = (
            mechanism.n_joints,
            mechanism.n_drives,
            mechanism.n_tendons,
            len(self.free),
        )
        self.tendons_of = [[i for i in range(self.nt) if mechanism.drive_of[i] == self.nj + d] for d in range(self.nd)]
        self.rubbing = [d for d, drive in enumerate(rig.drives) if drive.hysteresis is not None]
        inside = len(mechanism.plays) + len(mechanism.strains)
        self.carry = Layout(
            places=self.nd, pulls=self.nd, turned=self.nf, drives_turned=self.nd, rubbed=self.nd, inside=inside, begun=1
        )
        self.x = Layout(dt=1, angles=self.nf, speeds=self.nf, accelerations=self.nf, torques=self.nj, lowest=1)
        self.y = Layout(
            angles=self.nf, places=self.nd, speeds=self.nd, forces=self.nd, tensions=self.nt, friction=self.nf
        )

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """The parts of the rig that share neither joints nor drives."""
        pattern = self._arms(ca.SX.sym("q", self.nj), ca.SX.sym("s", self.nd), self.mechanism.parameters.symbols)
        moved = {(int(r), int(c)) for r, c in zip(*ca.sparsify(pattern).sparsity().get_triplet())}
        left, parts = set(range(self.nf)), []
        while left:
            joints, drives = {min(left)}, set[int]()
            while True:
                drives_now = {d for j, d in moved if j in joints}
                joints_now = joints | {j for j, d in moved if d in drives_now}
                if drives_now == drives and joints_now == joints:
                    break
                joints, drives = joints_now, drives_now
            left -= joints
            parts.append(Part(tuple(sorted(joints)), tuple(sorted(drives))))
        return tuple(parts)

    @property
    def one_sided(self) -> list[bool]:
        """Whether each drive pulls one way only: it winds one tendon."""
        return [len(tendons) == 1 for tendons in self.tendons_of]

    def _joints(self, free: Vector, offsets: bool = True) -> Vector:
        """Return the joints' angles, (n_joints,), or speeds, of those that move by themselves."""
        mechanism = self.mechanism
        return ca.mtimes(ca.SX(mechanism.spread), free) + (mechanism.offsets if offsets else 0)

    def _levers(self, angles: Vector, places: Vector) -> Matrix:
        return self.mechanism.length_jacobian(ca.vertcat(angles, places))

    def _shares(self, angles: Vector, places: Vector) -> Vector:
        """Return what each tendon adds to its drive's pull, (n_tendons,): its arms along those of the drive's first one."""
        levers = self._levers(angles, places)[:, : self.nj]
        shares = ca.SX.ones(self.nt)
        for tendons in self.tendons_of:
            first = levers[tendons[0], :]
            for i in tendons[1:]:
                shares[i] = ca.dot(levers[i, :], first) / ca.dot(first, first)
        return shares

    def _arms(self, angles: Vector, places: Vector, p: Vector) -> Matrix:
        """Return the torque per pull on joints that move by themselves, (n_free, n_drives) [m]."""
        first = [tendons[0] for tendons in self.tendons_of]
        levers = self._levers(angles, places)[first, : self.nj]
        arms = -ca.mtimes(levers, ca.SX(self.mechanism.spread)).T
        return ca.substitute(arms, self.mechanism.parameters.symbols, p)

    @cached_property
    def pull(self) -> ca.Function:
        """(θ, s, shares, p) → pulls of the drives at their joints' ends, and their slopes by the places, (n_drives,)."""
        mechanism = self.mechanism
        angles, places, shares = ca.SX.sym("angles", self.nj), ca.SX.sym("places", self.nd), ca.SX.sym("c", self.nt)
        tensions = mechanism.pulls(ca.vertcat(angles, places), ca.SX.zeros(mechanism.n_bodies)).joint
        pulls = ca.vertcat(*(sum((shares[i] * tensions[i] for i in own), ca.SX(0)) for own in self.tendons_of))
        slopes = ca.jtimes(pulls, places, ca.SX.ones(self.nd))
        arguments = [angles, places, shares, mechanism.parameters.symbols]
        return ca.Function("pull", arguments, ca.cse([ca.densify(pulls), ca.densify(slopes)]))

    @cached_property
    def geometry(self) -> ca.Function:
        """(θ, s, p) → arms (n_free, n_drives), shares (n_tendons,), steepest slopes of the pulls (n_drives,)."""
        angles, places, p = (
            ca.SX.sym("angles", self.nj),
            ca.SX.sym("places", self.nd),
            self.mechanism.parameters.symbols,
        )
        levers, steepest = self._levers(angles, places), []
        shares = self._shares(angles, places)
        for d, tendons in enumerate(self.tendons_of):
            stiff = (ca.fabs(shares[i] * levers[i, self.nj + d]) * self.mechanism.stiffest(i) for i in tendons)
            steepest.append(sum(stiff, ca.SX(0)))
        outputs = [ca.densify(self._arms(angles, places, p)), shares, ca.vertcat(*steepest)]
        return ca.Function("geometry", [angles, places, p], outputs)

    @cached_property
    def needed(self) -> ca.Function:
        """(θ_free, ω_free, α_free, s, d, τ_ext, p) → torques that tendons have to make, friction limits, (n_free,) each."""
        mechanism, nf = self.mechanism, self.nf
        free, speeds, accelerations, turned = (ca.SX.sym(name, nf) for name in ("free", "omega", "alpha", "turned"))
        places, external = ca.SX.sym("places", self.nd), ca.SX.sym("tau", self.nj)
        q = ca.vertcat(self._joints(free), places)
        v = ca.vertcat(self._joints(speeds, False), ca.SX.zeros(self.nd))
        pulls = mechanism.pulls(q, ca.SX.zeros(mechanism.n_bodies))
        limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)[: self.nj]
        spread = ca.SX(mechanism.spread)
        moving = mechanism.moving_forces(q, v, self._joints(accelerations, False))
        moving += (mechanism.dampings() * v - mechanism.passive_forces(q))[: self.nj] - external
        friction = ca.mtimes(ca.fabs(spread).T, ca.vertcat(*(limit.mean for limit in limits)))
        torques = ca.mtimes(spread.T, moving) + turned * friction
        arguments = [free, speeds, accelerations, places, turned, external, mechanism.parameters.symbols]
        return ca.Function("needed", arguments, ca.cse([ca.densify(torques), ca.densify(friction)]))

    @cached_property
    def driven(self) -> ca.Function:
        """(θ, s, ṡ, d_s, p) → force of each drive, and tensions at the drives."""
        mechanism = self.mechanism
        angles, places, rates, turned = (
            ca.SX.sym("angles", self.nj),
            *(ca.SX.sym(n, self.nd) for n in ("s", "r", "d")),
        )
        q, v = ca.vertcat(angles, places), ca.vertcat(ca.SX.zeros(self.nj), rates)
        pulls = mechanism.pulls(q, ca.SX.zeros(mechanism.n_bodies))
        limits = mechanism.friction_limits(q, v, pulls.joint, pulls.drive)[self.nj :]
        friction = [limit.mean * turned[d] + limit.asymmetry * ca.fabs(turned[d]) for d, limit in enumerate(limits)]
        drag = mechanism.dampings() * v - mechanism.passive_forces(q)
        force = drag[self.nj :] - pulls.forces[self.nj :] + ca.vertcat(*friction)
        return ca.Function(
            "driven", [angles, places, rates, turned, mechanism.parameters.symbols], [force, pulls.drive]
        )

    @cached_property
    def moved(self) -> ca.Function:
        """(θ, s, dt, p) → what has moved inside."""
        mechanism, q = self.mechanism, ca.SX.sym("q", self.mechanism.n_bodies)
        dt, p = ca.SX.sym("dt"), self.mechanism.parameters.symbols
        inside = [*mechanism.place(q).inside, *mechanism.crept(q, dt)]
        return ca.Function("moved", [q, dt, p], [ca.densify(ca.vertcat(*inside))])

    @cached_property
    def tangent(self) -> ca.Function:
        """(θ_free, f, s, d, τ_ext, p) → what the joints lack, A f − τ, and its slopes by θ_free at pulls that stay."""
        nf, p = self.nf, self.mechanism.parameters.symbols
        free, pulls, places = ca.SX.sym("free", nf), ca.SX.sym("pulls", self.nd), ca.SX.sym("places", self.nd)
        turned, external, zeros = ca.SX.sym("turned", nf), ca.SX.sym("tau", self.nj), ca.SX.zeros(nf)
        arms = self._arms(self._joints(free), places, p)
        lacking = ca.mtimes(arms, pulls) - self.needed(free, zeros, zeros, places, turned, external, p)[0]
        arguments = [free, pulls, places, turned, external, p]
        return ca.Function("tangent", arguments, ca.cse([lacking, ca.densify(ca.jacobian(lacking, free))]))

    def function(self) -> ca.Function:
        """Return (carry, x, p) → (carry⁺, y): the next command; p are the rig's numbers without what moves inside."""
        carry, x = ca.MX.sym("carry", self.carry.size), ca.MX.sym("x", self.x.size)
        inside_count = self.carry["inside"].stop - self.carry["inside"].start
        p = ca.MX.sym("p", self.mechanism.parameters.symbols.numel() - inside_count)
        was, wanted = self.carry.parts(carry), self.x.parts(x)
        numbers = ca.vertcat(p, was["inside"]) if inside_count else p
        step = self._sample()
        out = step(*(was[name] for name in was if name != "inside"), *(wanted[name] for name in wanted), numbers)
        named = dict(zip(step.name_out(), out))
        bodies = ca.vertcat(named.pop("joints"), named["places"])
        inside = self.moved(bodies, wanted["dt"], numbers) if inside_count else ca.MX(0, 1)
        after = self.carry.joined(
            **{name: named[name] for name in self.carry.names if name not in ("inside", "begun")},
            inside=inside,
            begun=ca.MX(1),
        )
        y = self.y.joined(**{name: named[name] for name in self.y.names})
        return ca.Function("command", [carry, x, p], [after, y], ["carry", "x", "p"], ["next", "y"])

    def _sample(self) -> ca.Function:
        """Return one sample as a function of the carry's parts, the wanted sample's, and all numbers."""
        nf, nd = self.nf, self.nd
        places, pulls, drives_turned, rubbed = (
            ca.MX.sym(n, nd) for n in ("places", "pulls", "drives_turned", "rubbed")
        )
        turned, begun, dt, lowest = ca.MX.sym("turned", nf), ca.MX.sym("begun"), ca.MX.sym("dt"), ca.MX.sym("lowest")
        angles, speeds, accelerations = (ca.MX.sym(n, nf) for n in ("angles", "speeds", "accelerations"))
        external = ca.MX.sym("external", self.nj)
        p = ca.MX.sym("p", self.mechanism.parameters.symbols.numel())
        turning = ca.fmin(ca.fmax(turned + speeds * dt / TURNS, -1), 1)
        held, s, f = angles, places, pulls
        for _ in range(ROUNDS):
            if any(len(part.drives) < len(part.joints) for part in self.parts):
                held, f = self._reached()(angles, held, f, s, turning, external, lowest, p)
            torques, friction = self.needed(held, speeds, accelerations, s, turning, external, p)
            joints = self._spread()(held)
            arms, shares, steepest = self.geometry(joints, s, p)
            f = self._pulls()(arms, torques, lowest, f)
            sprung, rubbing = f, rubbed
            if self.rubbing:
                sprung, rubbing = self._internal()(joints, s, f, pulls, rubbed, p)
            s = self._places()(joints, s, sprung, shares, steepest, p)
        rates = ca.if_else(begun > 0, (s - places) / ca.if_else(dt > 0, dt, 1), 0)
        along = ca.DM([self._radius(d) for d in range(nd)])
        drives_turning = ca.fmin(ca.fmax(drives_turned + begun * along * (s - places) / DRIVE_TURNS, -1), 1)
        forces, tensions = self.driven(joints, s, rates, drives_turning, p)
        names = ("places", "pulls", "drives_turned", "rubbed", "turned", "begun")
        before = dict(zip(names, (places, pulls, drives_turned, rubbed, turned, begun)))
        arguments = [before[name] for name in self.carry.names if name != "inside"]
        arguments += [dt, angles, speeds, accelerations, external, lowest, p]
        outputs = {
            "joints": joints,
            "angles": held,
            "places": s,
            "speeds": rates,
            "forces": forces,
            "tensions": tensions,
            "friction": friction,
            "pulls": f,
            "turned": turning,
            "drives_turned": drives_turning,
            "rubbed": rubbing,
        }
        named = [f"i{k}" for k in range(len(arguments))]
        return ca.Function("sample", arguments, list(outputs.values()), named, list(outputs))

    def _radius(self, drive: int) -> float:
        """Return by how much a drive's motion moves its tendon [m per its unit], for the scale of its friction."""
        part = self.rig.drives[drive]
        return part.radius.value if part.kind == "capstan" else 1.0

    def _winds(self, drive: int) -> int:
        """Return +1 where a positive motion of a drive draws its first tendon in, else −1."""
        return self.rig.tendons[self.tendons_of[drive][0]].winding if self.rig.drives[drive].kind == "capstan" else 1

    def _spread(self) -> ca.Function:
        free = ca.SX.sym("free", self.nf)
        return ca.Function("spread", [free], [ca.densify(self._joints(free))])

    def _pulls(self) -> ca.Function:
        """Return (arms, τ, lowest, f) → pulls: the least where there are enough drives; those of fewer stay."""
        arms, torques = ca.SX.sym("arms", self.nf, self.nd), ca.SX.sym("torques", self.nf)
        lowest, before = ca.SX.sym("lowest"), ca.SX.sym("before", self.nd)
        pulls, one_sided = ca.SX(before), self.one_sided
        for part in self.parts:
            joints, drives = list(part.joints), list(part.drives)
            if len(drives) >= len(joints):
                sided = [one_sided[d] for d in drives]
                block = ca.SX(len(joints), len(drives))
                pattern = self._pattern(joints, drives)
                for r, c in pattern:
                    block[r, c] = arms[joints[r], drives[c]]
                found = least_pulls(block, torques[joints], lowest * ca.SX.ones(len(drives)), sided)
                for d, is_sided, pull in zip(drives, sided, ca.vertsplit(found)):
                    pulls[d] = ca.fmax(pull, lowest) if is_sided else pull
        return ca.Function("pulls", [arms, torques, lowest, before], [ca.cse(ca.densify(pulls))])

    def _pattern(self, joints: Sequence[int], drives: Sequence[int]) -> list[tuple[int, int]]:
        symbols = ca.SX.sym("q", self.nj), ca.SX.sym("s", self.nd), self.mechanism.parameters.symbols
        arms = ca.sparsify(self._arms(*symbols))[list(joints), list(drives)]
        return [(int(r), int(c)) for r, c in zip(*arms.sparsity().get_triplet())]

    def _reached(self) -> ca.Function:
        """Return (wanted, θ, f, s, d, τ_ext, lowest, p) → the nearest angles that pulls can hold, and these pulls.

        At θ, f the joints lack r = A f − τ: after a change of the pulls they come to rest at θ − (∂r/∂θ)⁻¹ (r + A df).
        """
        nf, nd = self.nf, self.nd
        wanted, angles, turned = (ca.SX.sym(n, nf) for n in ("wanted", "angles", "turned"))
        pulls, places = ca.SX.sym("pulls", nd), ca.SX.sym("places", nd)
        external, lowest = ca.SX.sym("tau", self.nj), ca.SX.sym("lowest")
        p, held, f = self.mechanism.parameters.symbols, ca.SX(angles), ca.SX(pulls)
        for _ in range(REACHES):
            lacking, slopes = self.tangent(held, f, places, turned, external, p)
            arms = self._arms(self._joints(held), places, p)
            for part in self.parts:
                joints, drives = list(part.joints), list(part.drives)
                if len(drives) >= len(joints):
                    continue
                own = slopes[joints, joints]
                rest = held[joints] - solved(own, lacking[joints])
                moves = -ca.horzcat(*(solved(own, arms[joints, d]) for d in drives))
                away = wanted[joints] - rest
                change = solved(ca.mtimes(moves.T, moves), ca.mtimes(moves.T, away))
                after = ca.fmax(f[drives] + change, lowest)
                held[joints] = rest + ca.mtimes(moves, after - f[drives])
                f[drives] = after
        arguments = [wanted, angles, pulls, places, turned, external, lowest, p]
        return ca.Function("reached", arguments, ca.cse([ca.densify(held), ca.densify(f)]))

    def _places(self) -> ca.Function:
        """Return (θ, s, f, shares, steepest, p) → places at which the drives pull f."""
        nd = self.nd
        angles, before, pulls = ca.MX.sym("angles", self.nj), ca.MX.sym("before", nd), ca.MX.sym("pulls", nd)
        shares, steepest = ca.MX.sym("shares", self.nt), ca.MX.sym("steepest", nd)
        p = ca.MX.sym("p", self.mechanism.parameters.symbols.numel())
        rising = ca.DM([self._winds(d) for d in range(nd)])
        s, wide = before, ca.DM([FARTHEST / self._radius(d) for d in range(nd)])
        low, high = before - wide, before + wide
        refine = self._refine()
        for _ in range(NEWTON_STEPS):
            value, slope = self.pull(angles, s, shares, p)
            s, low, high = refine(s, low, high, rising * (value - pulls), rising * slope, steepest)
        return ca.Function("places", [angles, before, pulls, shares, steepest, p], [s])

    def _internal(self) -> ca.Function:
        """Return (θ, s, f, f before, e, p) → what is left for the springs, e⁺: friction in transmissions (`Hysteresis`).

        It is e h, with e in [−1, 1] that turns over as the pull changes by h: f_spring = f − e h.
        """
        angles, places = ca.SX.sym("angles", self.nj), ca.SX.sym("places", self.nd)
        pulls, before, rubbed = (ca.SX.sym(name, self.nd) for name in ("pulls", "before", "rubbed"))
        mechanism, sprung, after = self.mechanism, ca.SX(pulls), ca.SX(rubbed)
        q = ca.vertcat(angles, places)
        tensions = mechanism.tensions(q, ca.SX.zeros(mechanism.n_bodies))
        for d in self.rubbing:
            limit = mechanism.hysteresis_limit(d, q, tensions) / self._radius(d)
            turned = (pulls[d] - before[d]) / ca.fmax(limit, TINY_PULL)
            after[d] = ca.fmin(ca.fmax(rubbed[d] + turned, -1), 1)
            sprung[d] -= after[d] * limit
        arguments = [angles, places, pulls, before, rubbed, mechanism.parameters.symbols]
        return ca.Function("internal", arguments, ca.cse([ca.densify(sprung), ca.densify(after)]))

    def _refine(self) -> ca.Function:
        """Return (s, low, high, excess, slope, steepest) → the next of each: Newton's step, or the bracket's middle."""
        names = ("s", "low", "high", "excess", "slope", "steepest")
        s, low, high, excess, slope, steepest = (ca.SX.sym(name, self.nd) for name in names)
        below = excess < 0
        lower, upper = ca.if_else(below, s, low), ca.if_else(below, high, s)
        usable = slope > FLATTEST * steepest
        newton = s - excess / ca.if_else(usable, slope, 1)
        inner = ca.logic_and(usable, ca.logic_and(newton >= lower, newton <= upper))
        middle = (lower + upper) / 2
        arguments = [s, low, high, excess, slope, steepest]
        return ca.Function("refine", arguments, [ca.if_else(inner, newton, middle), lower, upper])

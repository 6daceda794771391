"""A naive twin of the adaptive filter in NumPy, written from docs/reference/adaptive-equations.md
and docs/explanation/adaptive-state.md alone: loops, full matrices.

It takes one sub-step and its slopes from `distal.model`, through `twin_model`. Numbers in brackets
are those equations. `taken` counts which branches were gone through, so that a test can say what it
has seen.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from math import ceil, cos, exp, inf, log, pi, sqrt
from typing import Any

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators import Robustness
from distal.model import Mechanism, clip_moments
from distal.rig import Rig
from distal.sensor_models import variance
from tests.estimators.adaptive.twin_model import TwinModel
from tests.estimators.adaptive.twin_states import declares_friction, sensor_at, states_of, travel_of
from tests.estimators.adaptive.twin_update import update

MEAN_TIME = 25e-3
LOST_FIRST = {"slider": 0.01, "capstan": 1.0}


@dataclass
class DriveMemory:
    """What is remembered of a drive's motion, and what friction does with its force."""

    s: float = 0.0
    doubt: float = 0.0
    speed: float = 0.0
    square: float = 0.0
    u: float = 0.0
    t: float = 0.0
    effort: float = 0.0  # Ū
    direction: float = 0.0  # t_c
    residual: float = 0.0  # r̄
    o: float = 0.0  # shift
    p: float = 1.0  # chance that its jump was real
    evidence: float = 0.0
    read: float = 0.0  # U of its last reading
    same: int = 0  # how often it came again


@dataclass
class Tracked:
    """One interval of a drive."""

    before: float
    s: float
    grown: float  # u⁺ − u
    bend: float
    variance: float  # R_s


@dataclass
class Sample:
    """What came out of one sample."""

    mean: Floats
    covariance: Floats
    innovations: Floats
    variances: Floats
    predicted_mean: Floats
    predicted_covariance: Floats
    transition: Floats


class Twin:
    """The filter of docs/reference/adaptive-equations.md for a rig and a set of guards."""

    def __init__(self, rig: Rig, guards: Robustness, references: tuple[Any, ...] = ()) -> None:
        self.rig, self.guards, self.taken = rig, guards, Counter[str]()
        self.positions, self.forces = rig.sensors_of("position"), rig.sensors_of("force")
        tensions = rig.sensors_of("tension")
        self.compared = (*self.forces, *tensions, *references)
        self.channels = (*self.positions, *tensions, *self.forces, *references)
        self.interval = 1.0 / max(s.rate for s in (*self.positions, *self.forces, *tensions))
        self.mechanism = Mechanism(rig)
        self.states = states_of(rig, self.mechanism, guards, references)
        self.model = TwinModel(rig, self.mechanism, self.states, self.interval)
        self.n, self.n_j, self.n_d = len(self.states), len(rig.joints), len(rig.drives)
        self.declared = [
            declares_friction(rig, i, guards.declared_friction) for i in range(self.n_d)
        ]
        self.position_of = [sensor_at(self.positions, drive) for drive in rig.drives]
        self.force_of = [sensor_at(self.forces, drive) for drive in rig.drives]

    # ---- names and places in the state ----

    def at(self, kind: str, of: int) -> int | None:
        return next((i for i, s in enumerate(self.states) if s.kind == kind and s.of == of), None)

    # ---- a whole log ----

    def run(self, times: Floats, samples: Floats) -> list[Sample]:
        """Samples after samples; the last part of an interval that was divided is the sample's
        own.
        """
        self.begin(samples[0])
        self.parts: list[Sample] = []
        found, before = [], times[0]
        for time, sample in zip(times, samples):
            dt = time - before
            parts = max(1, ceil(dt / (1.25 * self.interval) - 1e-9))
            for left in range(parts - 1, -1, -1):
                z, mask = np.nan_to_num(sample), np.isfinite(sample).astype(float)
                if left:
                    crossing = len(self.positions)
                    mask[:crossing] *= -(left + 1.0)
                    mask[crossing:] = 0.0
                    self.taken["bridge"] += 1
                out = self.sample(dt / parts, z, mask)
            missing = [np.isnan(sample[self.channels.index(s)]) for s in self.compared]
            out.innovations[missing] = np.nan
            found.append(out)
            before = time
        return found

    def begin(self, sample: Floats) -> None:
        """Prior mean and covariance, and what is remembered at the first sample."""
        self.m = np.array([s.mean for s in self.states])
        stds = np.array([s.std for s in self.states])
        self.drives = [DriveMemory() for _ in self.rig.drives]
        for i, drive in enumerate(self.rig.drives):
            sensor = self.position_of[i]
            if sensor is not None:
                z = sample[self.positions.index(sensor)]
                if np.isnan(z):
                    self.drives[i].u = LOST_FIRST[drive.kind] ** 2
                    self.taken["first missing"] += 1
                else:
                    self.drives[i].s = z - sensor.bias.value
            force = self.force_of[i]
            if force is not None and not np.isnan(sample[self.channels.index(force)]):
                self.drives[i].read = self.effort(i, sample)
            k = self.at("transmitted", i)
            if k is not None:
                self.m[k] = self.drives[i].read
                stds[k] = sqrt(self.play_at_rest(i) ** 2 / 3 + variance(force))
        self.P = np.diag(stds**2)
        self.prior_stds = stds

    def play_at_rest(self, drive: int) -> float:
        """H₀: the play's limit at pre-tension with the joints at `initial`."""
        part = self.rig.drives[drive]
        own = [i for i, t in enumerate(self.rig.tendons) if t.drive == part.name]
        radius = part.radius.value if part.kind == "capstan" else 1.0
        tension = sum(self.rig.tendons[i].pretension.value for i in own)
        joint = self.rig.joints[self.mechanism.joints_of[own[0]][0]]
        play = part.hysteresis
        return max(
            (play.constant.value + play.load.value * radius * tension)
            * (1 + play.slope.value * joint.initial.value),
            0,
        )

    # ---- one sample ----

    def sample(self, dt: float, z: Floats, mask: Floats) -> Sample:
        tracked = [self.track(i, dt, z, mask) for i in range(self.n_d)]
        transition = self.predict(dt, tracked)
        self.revert(dt, transition)
        for i in range(self.n_d):
            if self.at("transmitted", i) is not None:
                self.play(i, z, mask, transition)
        predicted = self.m.copy(), self.P.copy()
        innovations, variances = update(self, dt, z, mask, tracked)
        out = Sample(self.m.copy(), self.P.copy(), innovations, variances, *predicted, transition)
        self.parts.append(out)
        return out

    def track(self, i: int, dt: float, z_all: Floats, mask: Floats) -> Tracked:
        """Section 3."""
        sensor, d = self.position_of[i], self.drives[i]
        if sensor is None:
            return Tracked(0.0, 0.0, 0.0, 0.0, 0.0)
        column, noise = self.positions.index(sensor), variance(sensor)
        z, k = z_all[column] - sensor.bias.value, mask[column]
        if sensor.lag > 0.0:
            z = d.s + (z - d.s) * (1.0 - exp(-dt / sensor.lag))
        tau = d.t + dt
        start = d.s - d.p * d.o
        e = start + d.speed * dt
        o, doubt, evidence = d.o, d.doubt, d.evidence
        goes_on = k > 0 and doubt < dt and (z - o - e) * o > o**2 / 4
        if k > 0 and (goes_on or abs(z - e) < abs(z - o - e)):  # (2b)
            self.taken["a shift that ended"] += o != 0
            o = 0.0
        jump, far, reach = z - o - e, False, self.guards.wild_displacement
        force = self.force_of[i]
        judged = force is not None and mask[self.channels.index(force)] > 0 and reach < inf
        if reach < inf and k > 0 and not goes_on:
            u_before = 0.0 if o != 0 else d.u
            far = jump**2 > reach**2 * (d.square * tau**2 + u_before + 2 * noise)  # (1)
        if far:
            evidence = self.evidence(i, dt, jump, z_all) if judged else 0.0
            if judged and d.same >= 3:
                evidence = log(0.4 / 0.002)
            doubt = max(dt - 0.025, 0.0)
            o += jump
        else:
            is_same = (z - o - start) ** 2 < 1e-12 * noise
            stood = max(d.doubt, self.guards.persistence_alone)
            if k > 0 and d.t >= stood and not is_same:
                evidence = 0.0
            doubt = doubt + dt if o != 0 else 0.0
        lasting = self.guards.persistence if judged else self.guards.persistence_alone
        first = self.guards.real_jump
        weight = (1 - first) * max(1 - doubt / lasting, 0.0) + 0.002
        p = 1 / (1 + exp(-evidence) * weight / first)  # (2)
        if o == 0 or p > 0.97:
            o, p = 0.0, 1.0
        read = self.effort(i, z_all) if judged else d.read
        if k < 0:
            s = start + (z - start) / abs(k)
        else:
            s = z - o if k > 0 else e
        is_same = k > 0 and (s - start) ** 2 < 1e-12 * noise
        same = d.same + 1 if is_same and read == d.read else 0
        tells = k != 0 and not (o != 0 and is_same)
        b = 1.0 if k < 0 else (p if far else 1.0) if k > 0 else 0.0
        phi = exp(-dt / (2 * MEAN_TIME))  # (3)
        if k < 0:
            span, rate = dt, (s - start) / (dt if dt > 0 else 1.0)
        else:
            span, rate = tau, d.speed + (s - e) / (tau if tau > 0 else 1.0)
        a = b * (1 - exp(-span / MEAN_TIME))
        speed = d.speed * (phi + (1 - phi) * b)
        square = d.square
        if k != 0:
            speed, square = speed + a * (rate - d.speed), d.square + a * (rate**2 - d.square)
        either = (1 - p) * p * o**2
        astray = max(d.u, d.square * tau**2 + noise)
        if k < 0:  # (4)
            u = (s - start) ** 2
        else:
            u = either if tells else max(astray, either)
        if k == 0:
            wandering = 1.0 if self.rig.drives[i].kind == "capstan" else 0.01  # (4b)
            u = max(u, (wandering * max(tau - 5.0 / sensor.rate, 0.0)) ** 2)
            self.taken["led on, briefly" if tau < 1.5 / sensor.rate else "led on, for long"] += 1
        elif far:
            self.taken["wild displacement"] += p <= 0.5
        bend = s - start - d.speed * dt if b > 0.5 else 0.0  # (5)
        r_s = noise + u + (self.guards.bend_share * bend) ** 2  # (6)
        s += p * o
        tracked = Tracked(d.s, s, u - d.u, bend, r_s)
        self.taken["missing displacement"] += k == 0
        self.taken["crossed"] += k < 0
        self.drives[i] = replace(
            d,
            s=s,
            doubt=doubt,
            speed=speed,
            square=square,
            u=u,
            t=0.0 if tells else tau,
            o=o,
            p=p,
            evidence=evidence,
            read=read,
            same=same,
        )
        return tracked

    def effort(self, i: int, z: Floats) -> float:
        """U of a drive, less its known offset."""
        force = self.force_of[i]
        return float(z[self.channels.index(force)] - force.bias.value)

    def evidence(self, i: int, dt: float, jump: float, z: Floats) -> float:
        """E of (2)."""
        force = self.force_of[i]
        held, shown = self.jump_of(i)
        led = np.array([m.s + m.speed * dt for m in self.drives])
        for other in range(self.n_d):
            position = self.at("position", other)
            led[other] = (
                self.m[position]
                if position is not None
                else led[other] - self.error_at(other, led[other])[0]
            )
        still = self.m.copy()
        still[self.n_j : 2 * self.n_j] = 0.0
        found = self.model.compared(still, led, np.zeros(self.n_d))
        pull = found["pull"][0][i]
        limit, error, bias = (
            found["mean"][0][i],
            self.at("error", i),
            self.at("bias", self.compared.index(force)),
        )
        friction = self.at("friction", i)
        limit += self.m[friction] if friction is not None else 0.0
        pull -= self.m[error] if error is not None else 0.0
        pull += self.m[bias] if bias is not None else 0.0
        spread = variance(force) + limit**2 + (0.1 * pull) ** 2
        if self.at("transmitted", i) is not None:
            spread += self.play_at_rest(i) ** 2
        y = self.effort(i, z) - pull
        change = held * jump
        if len(self.rig.tendons_of(self.rig.drive_names[i])) == 1:  # it may go slack
            change = max(change, -pull) if pull > 0 else min(change, -pull) if pull < 0 else change
        c = min(max(y / change, shown / 2), 2.0) if change != 0 else shown / 2
        expected = c * change
        return min(max((y - expected / 2) * expected / spread, -50.0), 50.0)

    def jump_of(self, i: int) -> tuple[float, float]:
        """K_J with the joints held, and the share h of it that free joints leave in an interval."""
        n = self.n_j
        stiffness = np.zeros((n + self.n_d, n + self.n_d))
        for tendon in self.rig.tendons:
            row = np.zeros(n + self.n_d)
            at = self.rig.drive_names.index(tendon.drive)
            part = self.rig.drives[at]
            row[n + at] = part.radius.value if part.kind == "capstan" else 1.0
            if part.kind == "capstan" or tendon.side is not None:
                row[n + at] *= tendon.winding
            for name, arm in tendon.arms().items():
                row[self.rig.joint_names.index(name)] = -arm
            stiffness += tendon.stiffness.value * np.outer(row, row)
        held = stiffness[n + i, n + i]
        across = stiffness[:n, n + i]
        u = np.linalg.pinv(stiffness[:n, :n]) @ across
        at_rest = self.mechanism.mass_matrix(ca.SX.zeros(n + self.n_d))
        numbers = self.mechanism.parameters
        mass = ca.Function("mass", [numbers.symbols], [at_rest])(numbers.values).full()
        phase = min(sqrt(across @ u / (u @ mass @ u)) * self.interval, pi / 2)
        return held, min(max(1 - across @ u / held * (1 - cos(phase)), 0.0), 1.0)

    def error_at(self, i: int, s: float) -> tuple[float, Floats]:
        """ε(s) of a drive's position sensor at the mean, and its slope in x."""
        slope, sensor = np.zeros(self.n), self.position_of[i]
        index = self.positions.index(sensor)
        low, high = travel_of(self.rig, i)
        xi = (s - low) / (high - low)
        for k, state in enumerate(self.states):
            if state.kind == "linearity" and state.of == index:
                slope[k] = cos(pi * state.order * xi)
        return float(slope @ self.m), slope

    def positions_over(
        self, tracked: list[Tracked], dt: float
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """s̃, s̃⁺, ṡ of (7) and ∂s̃⁺/∂x, all at the mean."""
        start, end, slopes = np.zeros(self.n_d), np.zeros(self.n_d), np.zeros((self.n_d, self.n))
        for i in range(self.n_d):
            k = self.at("position", i)
            if k is not None:
                start[i] = end[i] = self.m[k]
                slopes[i, k] = 1.0
            else:
                start[i] = tracked[i].before - self.error_at(i, tracked[i].before)[0]
                error, slope = self.error_at(i, tracked[i].s)
                end[i], slopes[i] = tracked[i].s - error, -slope
        rates = (end - start) / dt if dt > 0 else np.zeros(self.n_d)  # (7)
        return start, end, rates, slopes

    def predict(self, dt: float, tracked: list[Tracked]) -> Floats:
        """Section 4, up to (12). Returns the transition so far."""
        n, n_j, n_d = self.n, self.n_j, self.n_d
        s, *self.position = self.positions_over(tracked, dt)
        _, rates, slopes = self.position
        s_s = np.hstack([slopes, np.eye(n_d)])
        s_theta, s_omega = np.zeros((n_j, n + n_d)), np.zeros((n_j, n + n_d))
        s_theta[:, :n_j], s_omega[:, n_j : 2 * n_j] = np.eye(n_j), np.eye(n_j)
        sigma, rho, x = np.zeros(n_j), np.zeros(n_j), self.m.copy()
        for i, state in enumerate(self.states):
            if state.kind == "torque":
                sigma[state.of] = sqrt(self.P[i, i])
        h = dt / self.model.substeps
        for _ in range(self.model.substeps):
            theta, omega, by_x, by_s, rest = self.model.substep(x, s, rates, h, sigma)
            direct = np.zeros((n_j, n + n_d))
            direct[:, 2 * n_j : n] = by_x[:, 2 * n_j :]
            s_omega = (
                by_x[:, :n_j] @ s_theta + by_x[:, n_j : 2 * n_j] @ s_omega + by_s @ s_s + direct
            )  # (9)
            s_theta = s_theta + h * s_omega
            rho = rho + rest  # (10)
            x[:n_j], x[n_j : 2 * n_j] = theta, omega  # (8)
            s = s + h * rates
        whole = np.vstack([s_theta, s_omega])
        m_x, m_s = whole[:, :n], whole[:, n:]
        transition = np.eye(n)
        transition[: 2 * n_j] = m_x
        # (11): what is not of the joints keeps its covariance
        self.P = transition @ self.P @ transition.T
        added = m_s @ np.diag([t.variance for t in tracked]) @ m_s.T
        added += np.diag([*self.followed(tracked), *(rho + self.unmodelled() ** 2 * dt)])
        self.P[: 2 * n_j, : 2 * n_j] += added
        for i, state in enumerate(self.states):
            self.P[i, i] += state.walk**2 * dt
        self.m[: 2 * n_j] = x[: 2 * n_j]
        return transition

    def unmodelled(self) -> Floats:
        return self.guards.unmodelled * np.array([j.unmodelled for j in self.rig.joints])

    def followed(self, tracked: list[Tracked]) -> Floats:
        """V_θ of (12)."""
        found = np.zeros(self.n_j)
        for i, drive in enumerate(self.rig.drives):
            if self.position_of[i] is None:
                continue
            share = max(tracked[i].grown, 0.0) * self.g(self.drives[i].t)
            radius = drive.radius.value if drive.kind == "capstan" else 1.0
            for j in range(self.n_j):
                own = [
                    t
                    for t in self.rig.tendons
                    if t.drive == drive.name and t.joint == self.rig.joints[j].name
                ]
                if own:
                    found[j] += share * (radius / own[0].insertion.radius.value) ** 2
            self.taken["followed"] += share > 0
        return found

    def g(self, t: float) -> float:
        return (t / (t + self.guards.follow_time)) ** 3

    def revert(self, dt: float, transition: Floats) -> None:
        for i, state in enumerate(self.states):
            if state.fade_rate > 0:
                f = exp(-state.fade_rate * dt)
                factor = np.eye(self.n)
                factor[i, i] = f
                self.m = factor @ self.m
                self.P = factor @ self.P @ factor
                self.P[i, i] += state.std**2 * (1 - f**2)  # (13)
                transition[i] = f * transition[i]

    def play(self, i: int, z: Floats, mask: Floats, transition: Floats) -> None:
        """Section 5."""
        force, k, d = self.force_of[i], self.at("transmitted", i), self.drives[i]
        column = self.channels.index(force)
        if mask[column] <= 0:
            self.taken["play without reading"] += 1
            return
        u, noise = self.effort(i, z), variance(force)
        h0 = self.play_at_rest(i)
        rho = min((h0 / 8) ** 2 / noise, 1.0)
        lam = 2 * rho / (1 + rho)
        effort = u if d.effort == 0 else d.effort + lam * (u - d.effort)  # (14)
        left = noise * lam / (2 - lam)
        self.drives[i] = d = replace(d, effort=effort)
        end, rates, slopes = self.position
        limit, by_x, by_s = (part.ravel() for part in self.model.play_limit(i, self.m, end))
        h = limit[0] + 2 * sqrt(left)
        b = self.at("bias", self.compared.index(force))
        bias = self.m[b] if b is not None else 0.0
        damping, damping_x, _ = self.model.compared(self.m, end, rates)["damping"]
        a = effort - bias - damping[i] * rates[i]
        clipped = a - h, a + h, self.m[k], sqrt(self.P[k, k]) + 1e-9
        moments = clip_moments(*(ca.DM(value) for value in clipped))  # (15)
        low, free, high = (
            float(slope) for slope in (moments.by_low, moments.by_mean, moments.by_high)
        )
        self.taken[
            "play held below" if low > 0.9 else "play held above" if high > 0.9 else "play free"
        ] += 1
        g = (high - low) * (by_x + by_s @ slopes)
        if b is not None:
            g[b] -= low + high
        g -= (low + high) * rates[i] * damping_x[i]
        g[k] += free
        across = g @ self.P
        self_variance = g @ self.P @ g + float(moments.rest) + (low + high) ** 2 * left
        self.P[k, :], self.P[:, k] = across, across
        self.P[k, k] = self_variance
        self.m[k] = float(moments.mean)
        transition[k] = g @ transition

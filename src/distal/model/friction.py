"""The limits of Coulomb friction at axles and along paths, what friction leaves of an uncertain
velocity, and the rebound of a body from its end stops: springs and dampers that only push.

F_stop = max(k_s (x − x_H) + b_s ẋ, 0) above x_H, min(k_s (x − x_L) + b_s ẋ, 0) below x_L, else 0:
equation (14), reconstructed. Its max and min are a correction: a stop only pushes, and as written
it would pull on release.

With friction, the velocity v⁺ solves A v⁺ + f = r with f_j = u_j where v_j⁺ > 0, −d_j where v_j⁺ <
0, and −d_j ≤ f_j ≤ u_j where v_j⁺ = 0. For a symmetric positive definite A there is one solution,
the minimum of ½ vᵀA v − rᵀv + Σ friction. To find which joints slip, the load is changed in a
straight line from one, r₀, for which the solution is known, to r (parametric pivoting; Cottle,
Pang, Stone, The Linear Complementarity Problem, 1992, section 4.5). On this line are events: at
each of them one joint stops or breaks loose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector, symbols
from distal.model.parameters import Parameters


@dataclass(frozen=True)
class Limit:
    """The friction limits of a body: `up` against motion to +, `down` against motion to −, both ≥
    0.

    They differ where a tendon rubs along its path: the limit is larger while it is drawn in than
    while it is let out.
    """

    up: Scalar
    down: Scalar

    @property
    def mean(self) -> Scalar:
        """Return the mean of both limits."""
        return (self.up + self.down) / 2

    @property
    def asymmetry(self) -> Scalar:
        """Return half the difference, `up` less `down`: 0 where friction is the same in both
        directions.
        """
        return (self.up - self.down) / 2

    def times(self, factor: Scalar) -> Limit:
        """Return both limits multiplied by a factor ≥ 0."""
        return Limit(factor * self.up, factor * self.down)


def axle_limit(p: Parameters, path: str, tension: Scalar) -> Limit:
    """Return the friction limit of an axle, μ r_a N_ref (N/N_ref)^e with N = T0 + Σ T; with e = 1
    it is μ r_a N, equation (12) reconstructed.

    Args:
        p: parameters of the rig.
        path: of the axle's friction in the description.
        tension: sum of the tensions that press it, Σ T [N].
    """
    if f"{path}.coefficient" not in p:
        return Limit(ca.SX(0), ca.SX(0))
    names = ("coefficient", "radius", "preload", "reference", "exponent")
    coefficient, radius, preload, reference, exponent = (p[f"{path}.{name}"] for name in names)
    load = preload + tension
    if not ca.SX(exponent).is_one():
        load = reference * (load / reference) ** exponent
    limit = coefficient * radius * load
    return Limit(limit, limit)


def capstan_limit(tension: Scalar, wrapped: Scalar, let_out: Scalar = 1) -> Limit:
    """Return the friction limits of a tendon along its path, by the capstan equation T_drive = T
    e^{±μβ} (Euler, Eytelwein).

    While the tendon is drawn in, the drive pulls with T e^{μβ}, and friction takes T (e^{μβ} − 1)
    of that. While it is let out, the drive pulls with T e^{−μβ}, and friction takes T (1 −
    e^{−μβ}). The `tension` T [N] is that at the joint's end, and `wrapped` is μβ [rad]. While the
    tendon is let out, μ is `let_out` times as large.
    """
    return Limit(tension * ca.expm1(wrapped), -tension * ca.expm1(-let_out * wrapped))


def stribeck(speed: Scalar, excess: Scalar, characteristic: Scalar) -> Scalar:
    """Return the factor 1 + e · exp(−(v/v_s)²) of Coulomb friction: stiction, which fades as a body
    begins to move.

    This is Stribeck's curve in the form of Armstrong-Hélouvry, Dupont and Canudas de Wit
    (Automatica 30, 1994). The `excess` e ≥ 0 is stiction beyond Coulomb friction, as a share of it.
    At a `speed` v equal to the `characteristic` speed v_s > 0, this excess has faded to exp(−1) of
    itself.
    """
    return 1 + excess * ca.exp(-((speed / characteristic) ** 2))


@dataclass(frozen=True)
class SoftMoments:
    """Moments of soft(z, l) = max(z − l₊, 0) + min(z + l₋, 0), the velocity that friction leaves,
    for a normal z with std σ. It is zero in stick; its derivative is 0 in stick and 1 in slip.

    Args:
        mean: E[soft(z, l)].
        slope: dE/dz, the probability of slip.
        rest: variance of soft(z, l) beyond slope² · σ².
        forward: probability of slip to +.
        back: probability of slip to −.
    """

    mean: Scalar
    slope: Scalar
    rest: Scalar
    forward: Scalar
    back: Scalar


def _below(x: Scalar) -> Scalar:
    """Return Φ(x), the probability that a standard normal variable is below x."""
    return (1 + ca.erf(x / ca.sqrt(2))) / 2


def _density(x: Scalar) -> Scalar:
    """Return φ(x), the density of a standard normal variable."""
    return ca.exp(-x * x / 2) / ca.sqrt(2 * ca.pi)


def clip_moments(low: Scalar, high: Scalar, mean: Scalar, std: Scalar) -> ClipMoments:
    """Return the moments of clip(z, a, b) with a = `low` ≤ b = `high`, for a normal z with mean m
    and std s > 0.

    With α = (a − m)/s and β = (b − m)/s the mean is E = aΦ(α) + b(1 − Φ(β)) + m(Φ(β) − Φ(α)) +
    s(φ(α) − φ(β)). Its slopes with respect to a, m and b are Φ(α), Φ(β) − Φ(α) and 1 − Φ(β). The
    arguments `mean` and `std` are m and s.
    """
    alpha = (low - mean) / std
    beta = (high - mean) / std
    under = _below(alpha)
    over = 1 - _below(beta)
    inside = 1 - under - over
    # moments are taken about m clipped to [a, b], so that no small number is the difference of
    # large ones, in double or float
    nearest = ca.fmin(ca.fmax(low - mean, 0), high - mean)
    a = low - mean - nearest
    b = high - mean - nearest
    moved = a * under + b * over - nearest * inside + std * (_density(alpha) - _density(beta))
    square = a * a * under + b * b * over + (nearest * nearest + std * std) * inside
    square += std * ((a - nearest) * _density(alpha) - (b - nearest) * _density(beta))
    variance = ca.fmax(square - moved * moved - (inside * std) ** 2, 0)
    return ClipMoments(mean + nearest + moved, under, inside, over, variance)


@dataclass(frozen=True)
class ClipMoments:
    """Moments of clip(z, a, b), a play operator's position, for a normal z with std σ.

    Args:
        mean: E[clip(z, a, b)].
        by_low: slope of the mean with respect to a: the probability that a holds it.
        by_mean: slope with respect to the mean of z: the probability that it is free.
        by_high: slope with respect to b: the probability that b holds it.
        rest: variance beyond by_mean² · σ².
    """

    mean: Scalar
    by_low: Scalar
    by_mean: Scalar
    by_high: Scalar
    rest: Scalar


def soft_moments(z: Scalar, limit: Limit, std: Scalar) -> SoftMoments:
    """Return mean, slope and remaining variance of soft(z, l) for a normal z with mean `z` and
    `std` s > 0.

    With u = (z − l₊)/s and w = (z + l₋)/s they are E = (z − l₊)Φ(u) + sφ(u) + (z + l₋)Φ(−w) − sφ(w)
    and the slope Φ(u) + Φ(−w). Filters use them because a body in stick may slip where its force is
    uncertain, while the linearisation of soft says that it cannot. The simulation never smooths
    friction. The `limit` l is a friction limit as a velocity.
    """
    # soft(z, l) = z − clip(z, −l₋, l₊)
    held = clip_moments(-limit.down - z, limit.up - z, ca.SX(0), std)
    return SoftMoments(-held.mean, held.by_low + held.by_high, held.rest, held.by_high, held.by_low)


def restitution(stiffness: Scalar, damping: Scalar, inertia: Scalar) -> Scalar:
    """Return the coefficient of restitution of a body that hits a stop which only pushes.

    e = exp(−(β/ω)(π − arctan(2βω/(ω² − β²)))) with β = b_s/2m, ω² = k_s/m − β²; contact ends where
    the force, not the penetration, is zero (Schwager & Pöschel, Granular Matter 9, 2007). It is
    zero where the contact is overdamped. The stop has the `stiffness` k_s and the `damping` b_s,
    the body the `inertia` m.
    """
    beta = damping / (2 * inertia)
    square = stiffness / inertia - beta * beta
    oscillates = square > 0
    omega = ca.sqrt(ca.if_else(oscillates, square, 1))
    phase = ca.pi - ca.atan2(2 * beta * omega, omega * omega - beta * beta)
    return ca.if_else(oscillates, ca.exp(-beta / omega * phase), 0)


@dataclass(frozen=True)
class Flight:
    """A kick of a body and the drift that follows, without stops.

    Args:
        free: velocity after the kick.
        position: at the start of the drift.
        before: velocity before the kick.
        length: of the kick [s].
        drift: length of the drift, h [s].
    """

    free: Scalar
    position: Scalar
    before: Scalar
    length: Scalar
    drift: Scalar


def bounce(
    rebound: Scalar, at_high: Scalar, stop_position: Scalar, flight: Flight
) -> tuple[Scalar, Scalar, Scalar]:
    """Return whether a body that meets a stop flies off again within the drift, and its velocity
    and position after it.

    The body meets the stop at `stop_position` (the upper one where `at_high`) at the time at which
    the parabola of its `flight` reaches it. It leaves with −e times its speed there, e being
    `rebound`, and flies on for the rest of the drift.
    """
    free = flight.free
    length = flight.length
    drift = flight.drift
    # motion towards the stop, s > 0: gap = u τ + ½ A τ², u the speed at the start of the drift
    towards = ca.if_else(at_high, 1, -1)
    acceleration = towards * (free - flight.before) / ca.if_else(length > 0, length, 1)
    start = towards * free - acceleration * drift / 2
    gap = towards * (stop_position - flight.position)
    speed = ca.sqrt(ca.fmax(start * start + 2 * acceleration * gap, 0))
    closing = start + speed
    time = ca.fmin(2 * gap / ca.if_else(closing > 0, closing, 1), drift)
    left = drift - time
    # it bounces if the flight after the hit outlasts the drift; otherwise it would come to rest
    # within the drift and counts as pressed
    flies = ca.logic_and(
        ca.logic_and(gap > 0, 2 * rebound * speed > acceleration * left), rebound > 0
    )
    away = -rebound * speed
    bounced = stop_position + towards * (away * left + acceleration * left * left / 2)
    return flies, towards * (away + acceleration * (left - drift / 2)), bounced


SWEEPS = 2
"""Number of sweeps of projected Gauss–Seidel that make the first guess; a good guess saves events.
Source: benchmark (python -m benchmarks.chains stick-slip).
"""

NO_EVENT = 2.0
"""Share of the load's change that stands for an event that does not come: any number above 1.
Source: definition (the change ends at a share of 1).
"""

EVENTS = 2
"""Number of events that are followed for each joint: a hundred thousand random loads needed no
more. Source: benchmark (docs/results/numerics.md).
"""


@dataclass(frozen=True)
class Slip:
    """Which joints slip, and in which direction, (n,) each: `forward` is 1 for a joint that slips
    to +, `back` is 1 for one that slips to −; otherwise they are 0.
    """

    forward: Vector
    back: Vector

    @property
    def moving(self) -> Vector:
        """1 for each joint that slips, in either direction, 0 for one that sticks, (n,)."""
        return self.forward + self.back

    def friction(self, up: Vector, down: Vector) -> Vector:
        """Return the friction of each joint that slips, 0 for one that sticks, (n,). The friction
        limits are `up` against + motion and `down` against − motion, (n,).
        """
        return self.forward * up - self.back * down


def solver(matrix: Matrix, weight: Vector) -> Callable[[Vector], Vector]:
    """Return the function b → x that solves A_SS x_S = b_S by L D Lᵀ for the joints S whose
    `weight` is 1; x = 0 for those whose weight is 0.

    A weight w between 0 and 1 blends both: x = w (w A w with the diagonal of A)⁻¹ w b. The `matrix`
    A, (n, n), is symmetric positive definite; the weights are (n,).
    """
    scaled = ca.mtimes([ca.diag(weight), matrix, ca.diag(weight)])
    for i in range(matrix.size1()):
        scaled[i, i] = matrix[i, i]
    factors = ca.ldl(scaled, False)
    return lambda b: weight * ca.ldl_solve(weight * b, *factors)


def slipping(
    matrix: Matrix,
    load: Vector,
    up: Vector,
    down: Vector,
    start: Vector | None = None,
    events: int | None = None,
) -> Slip:
    """Return which joints slip under a load, and in which direction.

    Args:
        matrix: A, symmetric positive definite, (n, n).
        load: r, (n,).
        up: friction limits against + motion, (n,).
        down: friction limits against − motion, (n,).
        start: velocities near the solution, (n,); default those of `SWEEPS` of Gauss–Seidel.
        events: number of events that are followed; default `EVENTS` for each joint.
    """
    n = matrix.size1()
    if matrix.sparsity().is_diag():
        # no joint moves another; where the limit is 0 (no friction, or no time passes) a load of 0
        # counts as slip: nothing holds the joint
        return Slip(load >= up, load < -down)
    v = _swept(matrix, load, up, down) if start is None else start
    # direction of each joint that slips, 0 for one that sticks
    signs = (v > 0) - (v < 0)
    residual = load - ca.mtimes(matrix, v)
    high = ca.if_else(v < 0, -down, up)
    low = ca.if_else(v > 0, up, -down)
    g = ca.fmin(ca.fmax(residual, low), high)
    change = residual - g
    state = (signs, v, g, ca.SX(1))
    follow = _event(n)
    for _ in range(EVENTS * n if events is None else events):
        state = follow(matrix, change, up, down, *state)
    return Slip(state[0] > 0, state[0] < 0)


def _swept(matrix: Matrix, load: Vector, up: Vector, down: Vector) -> Vector:
    """Return velocities near the solution, (n,), by `SWEEPS` of projected Gauss–Seidel from
    rest.
    """
    n = matrix.size1()
    v = [ca.SX(0)] * n
    for _ in range(SWEEPS):
        for j in range(n):
            left = load[j] - sum(matrix[j, i] * v[i] for i in range(n) if i != j)
            v[j] = (ca.fmax(left - up[j], 0) + ca.fmin(left + down[j], 0)) / matrix[j, j]
    return ca.vertcat(*v)


@lru_cache(maxsize=64)
def _event(n: int) -> ca.Function:
    """Return the function (A, the load's change, up, down, signs, velocity, friction, share left) →
    the last four of these after the next event.

    While the load changes in a straight line, the velocities of the joints that slip and the
    friction of those that stick change in straight lines, too. A joint stops where its velocity
    comes to zero; it breaks loose where its friction comes to a limit.

    The function stays one of its own in C: a chain follows many events, and their code is there
    once.
    """
    inputs = symbols(ca.SX, A=(n, n), change=n, u=n, d=n, signs=n, v=n, g=n, left=1)
    matrix, change, up, down, signs, v, g, left = inputs
    moving = signs * signs
    held = 1 - moving
    span = up + down
    dv = solver(matrix, moving)(change)
    dg = held * (change - ca.mtimes(matrix, dv))
    # for a joint that slips dg is zero, for one that sticks v and dv are zero
    distance = held * ((dg > 0) * span - down - g) - v
    rate = dv + dg
    happens = ca.logic_or(signs * dv < 0, dg != 0)
    time = ca.fmax(distance / (rate + (rate == 0)), 0)
    times = NO_EVENT + happens * (time - NO_EVENT)
    soonest = left
    for j in range(n):
        soonest = ca.fmin(soonest, times[j])
    after = list[Scalar]()
    assigned = ca.SX(soonest >= left)
    for j in range(n):
        mine = ca.logic_and(times[j] <= soonest, 1 - assigned)
        assigned = assigned + mine
        after.append(signs[j] + mine * (ca.sign(dg[j]) - signs[j]))
    # the velocity of a joint that has just stopped is zero
    stands = ca.vertcat(*after) ** 2
    state = [ca.vertcat(*after), stands * (v + soonest * dv), g + soonest * dg, left - soonest]
    return ca.Function(
        "event", inputs, [ca.densify(part) for part in state], {"cse": True, "never_inline": True}
    )

"""Exact Coulomb friction: a projection of the velocity, not a smoothed sign."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.expressions import Scalar


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


def soft(z: Scalar, limit: Limit | Scalar) -> Scalar:
    """Return max(z − l₊, 0) + min(z + l₋, 0): the velocity that friction leaves, zero in stick.

    It is the exact solution v of z ∈ v + l · sgn(v) with the set-valued sgn(0) = [−1, 1]; its
    derivative is 0 in stick and 1 in slip. A body in stick does not creep, whatever the step. The
    velocity without friction is z. The `limit` l = b · μN ≥ 0 is a friction limit as a velocity, a
    `Limit` where it depends on the direction.
    """
    return slipped(*slip(z, limit), z, limit)


def slip(z: Scalar, limit: Limit | Scalar, factor: Scalar = 1) -> tuple[Scalar, Scalar]:
    """Return (f, b) for `slipped`: f is `factor` where a velocity z slips to +, b where it slips to
    −; otherwise they are 0. The `limit` is that of `soft`.
    """
    up, down = (limit.up, limit.down) if isinstance(limit, Limit) else (limit, limit)
    # where the limit is 0 (no friction, or no time passes) z = 0 counts as slip: nothing holds the
    # body
    return (z >= up) * factor, (z < -down) * factor


def slipped(forward: Scalar, back: Scalar, z: Scalar, limit: Limit | Scalar) -> Scalar:
    """Return (f + b) z − f l₊ + b l₋: `soft` written as products, whose derivatives need no choice
    and no division.

    The factors `forward` f and `back` b are those of `slip`; z and the `limit` are those of `soft`.
    """
    up, down = (limit.up, limit.down) if isinstance(limit, Limit) else (limit, limit)
    if ca.is_equal(ca.SX(up), ca.SX(down), 3):
        return (forward + back) * z - (forward - back) * up
    return (forward + back) * z - forward * up + back * down


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


def free_response(damping: Scalar, inertia: Scalar, step: Scalar) -> tuple[Scalar, Scalar]:
    """Return (a, b) of v⁺ = a v + b F, the exact response of a body over a `step` h [s] to a
    constant force F, with viscous `damping` c.

    a = exp(−c h/m), b = (1 − a)/c, and b = h/m as c → 0; the `inertia` m is a mass or a moment of
    inertia.
    """
    if isinstance(damping, ca.SX) and damping.is_zero():
        return ca.SX(1), step / inertia
    x = damping * step / inertia
    small = x < 1e-5
    # (1 − e^{−x})/x; below 1e-5 its series, exact to 1e-16, keeps value and derivative finite at x
    # = 0
    ratio = ca.if_else(small, 1 - x / 2 + x * x / 6, -ca.expm1(-x) / ca.if_else(small, 1, x))
    return ca.exp(-x), step / inertia * ratio


def load_dependent_limit(
    coefficient: Scalar, radius: Scalar, load: Scalar, reference: Scalar, exponent: Scalar
) -> Scalar:
    """Return the friction limit μ r_a N_ref (N/N_ref)^e; with e = 1 it is μ r_a N, equation (12)
    reconstructed.

    The `coefficient` is μ, `radius` r_a [m], `load` N = T0 + Σ T ≥ 0 [N], `reference` N_ref [N],
    `exponent` e ≥ 1.
    """
    if isinstance(exponent, ca.SX) and exponent.is_one():
        return coefficient * radius * load
    return coefficient * radius * reference * (load / reference) ** exponent


@dataclass(frozen=True)
class SoftMoments:
    """Moments of soft(z, l) for a normal z with std σ.

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


def soft_moments(z: Scalar, limit: Limit | Scalar, std: Scalar) -> SoftMoments:
    """Return mean, slope and remaining variance of soft(z, l) for a normal z with mean `z` and
    `std` s > 0.

    With u = (z − l₊)/s and w = (z + l₋)/s they are E = (z − l₊)Φ(u) + sφ(u) + (z + l₋)Φ(−w) − sφ(w)
    and the slope Φ(u) + Φ(−w). Filters use them because a body in stick may slip where its force is
    uncertain, while the linearisation of `soft` says that it cannot. The simulation never smooths
    friction. The `limit` is that of `soft`.
    """
    limits = limit if isinstance(limit, Limit) else Limit(limit, limit)
    # soft(z, l) = z − clip(z, −l₋, l₊)
    held = clip_moments(-limits.down - z, limits.up - z, ca.SX(0), std)
    return SoftMoments(-held.mean, held.by_low + held.by_high, held.rest, held.by_high, held.by_low)

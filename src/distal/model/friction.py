"""Exact Coulomb friction: a projection of the velocity, not a smoothed sign."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.expressions import Scalar


@dataclass(frozen=True)
class Limit:
    """What friction can take up: against motion to + and against motion to −, both ≥ 0.

    They differ where a tendon rubs along its path: drawing it in takes more than letting it out
    gives back.
    """

    up: Scalar
    down: Scalar

    @property
    def mean(self) -> Scalar:
        """Return half the sum of both."""
        return (self.up + self.down) / 2

    @property
    def asymmetry(self) -> Scalar:
        """Return half their difference, up less down: 0 where friction is the same in both
        directions.
        """
        return (self.up - self.down) / 2

    def times(self, factor: Scalar) -> Limit:
        """Return both multiplied by a factor ≥ 0."""
        return Limit(factor * self.up, factor * self.down)


def soft(z: Scalar, limit: Limit | Scalar) -> Scalar:
    """Return max(z − l₊, 0) + min(z + l₋, 0): the velocity left after friction of impulse l; zero
    means stick.

    It is the exact solution v of z ∈ v + l · sgn(v) with the set-valued sgn(0) = [−1, 1]; its
    derivative is 0 in stick and 1 in slip. A stuck body does not creep, whatever the step. The
    velocity without friction is z, the `limit` is one as a velocity, b · μN ≥ 0; a `Limit` where it
    depends on the direction.
    """
    return slipped(*slip(z, limit), z, limit)


def slip(z: Scalar, limit: Limit | Scalar, factor: Scalar = 1) -> tuple[Scalar, Scalar]:
    """Return (f, b): `factor` in slip to + or to −, else 0, of a velocity z and a limit as in
    `soft`; see `slipped`.
    """
    up, down = (limit.up, limit.down) if isinstance(limit, Limit) else (limit, limit)
    # without friction, or where no time passes, z = 0 = l is slip: what does not hold does not stop
    # either
    return (z >= up) * factor, (z < -down) * factor


def slipped(forward: Scalar, back: Scalar, z: Scalar, limit: Limit | Scalar) -> Scalar:
    """Return (f + b) z − f l₊ + b l₋: `soft` as products, whose derivatives need no choice and no
    division.

    `forward` f and `back` b are those of `slip`; z and the limit are those of `soft`.
    """
    up, down = (limit.up, limit.down) if isinstance(limit, Limit) else (limit, limit)
    if ca.is_equal(ca.SX(up), ca.SX(down), 3):
        return (forward + back) * z - (forward - back) * up
    return (forward + back) * z - forward * up + back * down


def capstan_limit(tension: Scalar, wrapped: Scalar, let_out: Scalar = 1) -> Limit:
    """Return friction of a tendon along its path, by the capstan equation T_drive = T e^{±μβ}
    (Euler, Eytelwein).

    Drawn in, the drive pulls T e^{μβ}: friction takes T (e^{μβ} − 1); let out, T e^{−μβ}: it takes
    T (1 − e^{−μβ}). The `tension` T [N] is that at the joint's end, `wrapped` is μβ [rad], and μ is
    `let_out` times as large as it is let out.
    """
    return Limit(tension * ca.expm1(wrapped), -tension * ca.expm1(-let_out * wrapped))


def stribeck(speed: Scalar, excess: Scalar, characteristic: Scalar) -> Scalar:
    """Return the factor 1 + e · exp(−(v/v_s)²) of Coulomb friction: stiction that fades as a body
    begins to move.

    Stribeck's curve in the form of Armstrong-Hélouvry, Dupont and Canudas de Wit (Automatica 30,
    1994). The excess e ≥ 0 is stiction beyond Coulomb friction, as a share of it; at the
    `characteristic` speed v_s > 0 it has faded to 1/e of itself.
    """
    return 1 + excess * ca.exp(-((speed / characteristic) ** 2))


def free_response(damping: Scalar, inertia: Scalar, step: Scalar) -> tuple[Scalar, Scalar]:
    """Return (a, b) of v⁺ = a v + b F, the exact response over a step h [s] to a constant force F
    with viscous damping c.

    a = exp(−c h/m), b = (1 − a)/c, and b = h/m as c → 0; the inertia m is a mass or a moment of
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
    """What `soft` makes of a normal distribution.

    Args:
        mean: E[soft(z, l)].
        slope: dE/dz, the chance to slip.
        rest: variance beyond slope² · σ².
        forward: the chance to slip to +, `back` that to −.
    """

    mean: Scalar
    slope: Scalar
    rest: Scalar
    forward: Scalar
    back: Scalar


def _below(x: Scalar) -> Scalar:
    """Return Φ(x), the chance that a standard normal variable is below x."""
    return (1 + ca.erf(x / ca.sqrt(2))) / 2


def _density(x: Scalar) -> Scalar:
    """Return φ(x), the density of a standard normal variable."""
    return ca.exp(-x * x / 2) / ca.sqrt(2 * ca.pi)


def clip_moments(low: Scalar, high: Scalar, mean: Scalar, std: Scalar) -> ClipMoments:
    """Return mean, slopes and remaining variance of clip(z, low, high), a = low ≤ b = high, for a
    normal z.

    With its mean m and std s > 0, α = (a − m)/s, β = (b − m)/s: E = aΦ(α) + b(1 − Φ(β)) + m(Φ(β) −
    Φ(α)) + s(φ(α) − φ(β)); its slopes with respect to a, m and b are Φ(α), Φ(β) − Φ(α) and 1 −
    Φ(β).
    """
    alpha = (low - mean) / std
    beta = (high - mean) / std
    under = _below(alpha)
    over = 1 - _below(beta)
    inside = 1 - under - over
    # about m clipped: neither held nor free, in double or float, is a small number left over from
    # large ones
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
    """What a play operator makes of a normal distribution.

    Args:
        mean: E[clip(z, a, b)].
        by_low: its slope with respect to a, `by_high` to b: the chance to be held by it.
        by_mean: with respect to the mean of z: the chance to be free.
        rest: variance beyond by_mean² · σ².
    """

    mean: Scalar
    by_low: Scalar
    by_mean: Scalar
    by_high: Scalar
    rest: Scalar


def soft_moments(z: Scalar, limit: Limit | Scalar, std: Scalar) -> SoftMoments:
    """Return mean, slope and remaining variance of soft(z, l) for z normal with std s > 0; `z` is
    its mean.

    With u = (z − l₊)/s, w = (z + l₋)/s: E = (z − l₊)Φ(u) + sφ(u) + (z + l₋)Φ(−w) − sφ(w), slope
    Φ(u) + Φ(−w). A stuck body whose force is uncertain may slip: its linearisation alone says that
    it cannot. For filters only; simulation never smooths. The limit is that of `soft`.
    """
    limits = limit if isinstance(limit, Limit) else Limit(limit, limit)
    # soft(z, l) = z − clip(z, −l₋, l₊)
    held = clip_moments(-limits.down - z, limits.up - z, ca.SX(0), std)
    return SoftMoments(-held.mean, held.by_low + held.by_high, held.rest, held.by_high, held.by_low)

"""Exact Coulomb friction: a projection of the velocity, not a smoothed sign."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca


def soft(z: Any, limit: Any) -> Any:
    """Return max(z − l, 0) + min(z + l, 0): the velocity left after friction of impulse l; zero means stick.

    It is the exact solution v of z ∈ v + l · sgn(v) with the set-valued sgn(0) = [−1, 1]; its derivative is 0 in
    stick and 1 in slip. A stuck body does not creep, whatever the step.

    Args:
        z: velocity without friction.
        limit: friction limit as a velocity, b · μN ≥ 0.
    """
    return ca.fmax(z - limit, 0) + ca.fmin(z + limit, 0)


def free_response(damping: Any, inertia: Any, step: Any) -> tuple[Any, Any]:
    """Return (a, b) of v⁺ = a v + b F, the exact response over `step` to a constant force F with viscous damping c.

    a = exp(−c h/m), b = (1 − a)/c, and b = h/m as c → 0.

    Args:
        damping: viscous coefficient c.
        inertia: mass or moment of inertia m.
        step: h [s].
    """
    if isinstance(damping, ca.SX) and damping.is_zero():
        return ca.SX(1), step / inertia
    x = damping * step / inertia
    small = x < 1e-5
    # (1 − e^{−x})/x; below 1e-5 its series, exact to 1e-16, keeps value and derivative finite at x = 0
    ratio = ca.if_else(small, 1 - x / 2 + x * x / 6, -ca.expm1(-x) / ca.if_else(small, 1, x))
    return ca.exp(-x), step / inertia * ratio


def load_dependent_limit(coefficient: Any, radius: Any, load: Any, reference: Any, exponent: Any) -> Any:
    """Return the friction limit μ r_a N_ref (N/N_ref)^e; with e = 1 it is μ r_a N, equation (12) reconstructed.

    Args:
        coefficient: μ.
        radius: r_a [m].
        load: N = T0 + Σ T [N], not negative.
        reference: N_ref [N].
        exponent: e ≥ 1.
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
    """

    mean: Any
    slope: Any
    rest: Any


def soft_moments(z: Any, limit: Any, std: Any) -> SoftMoments:
    """Return mean, slope and remaining variance of soft(z, l) for z normal with standard deviation s.

    With u = (z − l)/s, w = (z + l)/s: E = (z − l)Φ(u) + sφ(u) + (z + l)Φ(−w) − sφ(w), slope Φ(u) + Φ(−w). A stuck body
    whose force is uncertain may slip: its linearisation alone says that it cannot. For filters only; simulation never
    smooths.

    Args:
        z: mean of the velocity without friction.
        limit: friction limit as a velocity.
        std: s > 0.
    """

    def below(x: Any) -> Any:
        return (1 + ca.erf(x / ca.sqrt(2))) / 2

    def density(x: Any) -> Any:
        return ca.exp(-x * x / 2) / ca.sqrt(2 * ca.pi)

    up, down = z - limit, z + limit
    u, w = up / std, down / std
    mean = up * below(u) + std * density(u) + down * below(-w) - std * density(w)
    square = (up * up + std * std) * below(u) + up * std * density(u)
    square += (down * down + std * std) * below(-w) - down * std * density(w)
    slope = below(u) + below(-w)
    return SoftMoments(mean, slope, ca.fmax(square - mean * mean - (slope * std) ** 2, 0))

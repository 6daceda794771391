"""A tendon whose excursion is a polynomial in the angles of several joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal, Self

import casadi as ca
from pydantic import Field, model_validator

from distal.rig.insertions.crossed import Size
from distal.rig.quantities import Description, In, Parameter

if TYPE_CHECKING:
    from distal.expressions import Scalar


class Term(Description):
    """One term of a polynomial: coefficient · Π θ_j^{power_j}."""

    powers: tuple[int, ...] = Field(min_length=1, description="power of each joint's angle [rad]")
    coefficient: Annotated[Parameter, In("m")] = Field(
        description="metres, per radian to the sum of the powers"
    )


HIGHEST_POWER = 9
"""Largest power of an angle in a term [1]. Source: judgement."""


class Polynomial(Description):
    """A crossing whose excursion is a polynomial in several angles: ℓ = l + x − scale · (e(θ) −
    e(0)).

    Outside of `range` the excursion goes on as a straight line, with the moment arm at the end of
    the range.
    """

    kind: Literal["polynomial"]
    joints: tuple[str, ...] = Field(min_length=1, description="names of the joints")
    terms: tuple[Term, ...] = Field(min_length=1, description="its terms")
    range: tuple[Annotated[tuple[float, float], In("rad")], ...] = Field(
        min_length=1, description="[low, high] of each joint for which it was made"
    )
    scale: Annotated[Parameter, In("", "positive")] = Field(
        Parameter(value=1.0),
        description="all moment arms are multiplied by this; its std is how well they are known",
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        for name in self.joints:
            if self.joints.count(name) > 1:
                raise ValueError(f"joints: '{name}' stands more than once")
        if len(self.range) != len(self.joints):
            raise ValueError(
                f"range: one [low, high] for each of {len(self.joints)} joints is needed, "
                f"{len(self.range)} came"
            )
        for i, term in enumerate(self.terms):
            if len(term.powers) != len(self.joints):
                raise ValueError(
                    f"terms.{i}.powers: one for each of {len(self.joints)} joints is needed, "
                    f"{len(term.powers)} came"
                )
            if min(term.powers) < 0 or max(term.powers) > HIGHEST_POWER:
                raise ValueError(
                    f"terms.{i}.powers: must be from 0 to {HIGHEST_POWER}, {list(term.powers)} came"
                )
        for j, name in enumerate(self.joints):
            if not any(term.powers[j] > 0 and term.coefficient.value != 0.0 for term in self.terms):
                raise ValueError(
                    f"joints: '{name}' has no term with a power of it; leave it out, or add one"
                )
        return self

    def arms(self, angles: dict[str, float]) -> dict[str, float]:
        """Return the moment arms by joint [m], positive where the tendon pulls to +θ, at `angles`
        by joint [rad], each limited to its range; a joint without an angle is at 0.
        """
        at = [
            min(max(angles.get(name, 0.0), low), high)
            for name, (low, high) in zip(self.joints, self.range)
        ]
        arms = dict.fromkeys(self.joints, 0.0)
        for term in self.terms:
            for j, name in enumerate(self.joints):
                slope = term.coefficient.value * term.powers[j]
                for i, power in enumerate(term.powers):
                    slope *= at[i] ** max(power - (i == j), 0)
                arms[name] += self.scale.value * slope
        return arms

    def elongation(
        self, size: Size, side: int, angles: Sequence[Scalar], displacement: Scalar
    ) -> Scalar:
        """Return ℓ − l = x − scale · (e(θ) − e(0)) [m], by how much the `angles` θ and the
        `displacement` x of the drive lengthen the tendon's way; see `Size`.

        The `side` is not used: the signs of the terms say to which side the tendon pulls.
        """
        coefficients = [size(f"terms.{k}.coefficient") for k in range(len(self.terms))]
        zero = self._excursion(coefficients, [ca.SX(0)] * len(angles))
        return displacement - size("scale") * (self._excursion(coefficients, angles) - zero)

    def _excursion(self, coefficients: Sequence[Scalar], angles: Sequence[Scalar]) -> Scalar:
        """Return e(θ) = Σ c Π θ_j^{n_j}. Outside of the range it is e(θ_c) + Σ a_j (θ_j − θ_c,j),
        where θ_c is θ limited to the range.

        a_j is the moment arm at the end of θ_j's own range with the other angles in the middle of
        theirs. So no length jumps, and no arm grows beyond what it is somewhere in the range.
        """
        clipped = [
            ca.fmin(ca.fmax(angle, low), high) for angle, (low, high) in zip(angles, self.range)
        ]
        total = ca.SX(0)
        for term, coefficient in zip(self.terms, coefficients):
            total += coefficient * _product(clipped, term.powers)
        middle = [(low + high) / 2 for low, high in self.range]
        for j, (low, high) in enumerate(self.range):
            ends = [
                self._slope(coefficients, [*middle[:j], end, *middle[j + 1 :]], j)
                for end in (low, high)
            ]
            total += ends[0] * ca.fmin(angles[j] - low, 0) + ends[1] * ca.fmax(angles[j] - high, 0)
        return total

    def _slope(self, coefficients: Sequence[Scalar], at: Sequence[Scalar], joint: int) -> Scalar:
        """Return ∂e/∂θ_j of a `joint` j at given angles."""
        total = ca.SX(0)
        for term, coefficient in zip(self.terms, coefficients):
            power = term.powers[joint]
            if power > 0:
                lower = tuple(p - (i == joint) for i, p in enumerate(term.powers))
                total += coefficient * power * _product(at, lower)
        return total


def _product(angles: Sequence[Scalar], powers: Sequence[int]) -> Scalar:
    product = ca.SX(1)
    for angle, power in zip(angles, powers):
        for _ in range(power):
            product *= angle
    return product

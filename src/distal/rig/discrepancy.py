"""What logs with a known angle taught of the model's own error: a correction of the angle, and how far to trust it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from distal.rig.affine import AffineJoint, Row
from distal.rig.quantities import Description, In

CONSTANT = "1"
"""The term that is the same everywhere."""


def factors(term: str) -> tuple[str, ...]:
    """Return the variables whose product a term is; none for the constant.

    Args:
        term: variables with ``*`` between them.
    """
    return () if term == CONSTANT else tuple(factor.strip() for factor in term.split("*"))


def check_terms(terms: Sequence[str], variables: Sequence[str], joints: Sequence[AffineJoint]) -> None:
    """Refuse terms of variables that there are not, and coefficients that are more or fewer than the terms.

    Args:
        terms: products of variables.
        variables: that a term may hold.
        joints: with a coefficient for each term.

    Raises:
        ValueError: says which.
    """
    for term in terms:
        for factor in factors(term):
            if factor not in variables:
                raise ValueError(f"terms: '{factor}' is no variable ({', '.join(variables)})")
    for joint in joints:
        if len(joint.coefficients) != len(terms):
            raise ValueError(
                f"joint '{joint.joint}': {len(terms)} coefficients are needed, one for each term, "
                f"{len(joint.coefficients)} came"
            )


class Discrepancy(Description):
    """The joints' angles less what `adaptive` makes of them, δ = Σ b_i φ_i of its sensors; `distal fit` writes it.

    A term φ is a product of variables: ``SENSOR`` (its reading, less `centre`, over `scale`), ``abs(SENSOR)``,
    ``play(SENSOR)`` (that variable after a play of half-width `play`), ``angle(JOINT)`` (what the filter itself says,
    likewise scaled; alone, not in a product).
    """

    terms: tuple[str, ...] = Field(min_length=1, description="what δ is a sum of; '1' is the constant")
    channels: tuple[str, ...] = Field(min_length=1, description="the sensors, in the estimator's order")
    centre: Row = Field(description="mean of each sensor's readings, then of each joint's angle by the filter [SI]")
    scale: Row = Field(description="their standard deviations [SI]; 1 for what was constant")
    low: Row = Field(description="smallest of each [SI]; below it the band grows")
    high: Row = Field(description="largest of each [SI]")
    rate: Row = Field(description="RMS speed of each [SI/s]: how fast a missing value loses its worth")
    play: float = Field(gt=0.0, description="half-width of the plays, in units of `scale`")
    distance: tuple[Row, ...] = Field(
        description="matrix M of the squared Mahalanobis distance zᵀ M z of the sensors' scaled readings z"
    )
    reach: float = Field(gt=0.0, description="largest such distance in the logs")
    correlation_time: Annotated[float, In("s", "positive")] = Field(description="of what is left")
    own: float = Field(1.0, ge=0.0, le=1.0, description="share of the filter's own standard deviation that counts")
    spread: Row = Field(description="RMS of each joint's δ over the logs [rad]: outside the range so much is not known")
    logs: int = Field(ge=1, description="number of logs")
    joints: tuple[AffineJoint, ...] = Field(min_length=1, description="coefficients and covariance, one for each joint")

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        m, n = len(self.channels), len(self.channels) + len(self.joints)
        for name in ("centre", "scale", "low", "high", "rate"):
            if len(getattr(self, name)) != n:
                raise ValueError(
                    f"{name} must have {n} entries, one for each channel and joint; {len(getattr(self, name))} came"
                )
        if len(self.spread) != len(self.joints):
            raise ValueError(f"spread must have {len(self.joints)} entries, one for each joint")
        if len(self.distance) != m or any(len(row) != m for row in self.distance):
            raise ValueError(f"distance must be {m} rows of {m} numbers")
        if any(not value > 0.0 for value in self.scale) or not np.isfinite(self.scale).all():
            raise ValueError("every scale must be positive")
        if any(not low <= high for low, high in zip(self.low, self.high)):
            raise ValueError("low must not be above high")
        check_terms(self.terms, self.variables, self.joints)
        return self

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of all variables that a term may hold."""
        plain, joints = self.channels, [joint.joint for joint in self.joints]
        return (
            *plain,
            *(f"abs({name})" for name in plain),
            *(f"play({name})" for name in plain),
            *(f"angle({joint})" for joint in joints),
        )

    @property
    def played(self) -> tuple[int, ...]:
        """Indices of the channels that a play follows."""
        used = {factor for term in self.terms for factor in factors(term)}
        return tuple(i for i, name in enumerate(self.channels) if f"play({name})" in used)

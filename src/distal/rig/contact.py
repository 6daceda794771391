"""What logs with a known torque at the joint taught of it: a map from what is read at the proximal end."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from distal.rig.affine import AffineJoint, Row
from distal.rig.discrepancy import check_terms, factors
from distal.rig.quantities import Description, In


class Contact(Description):
    """The torque on the joints from outside, τ = Σ b_i φ_i of what is read at the proximal end; `distal fit` writes it.

    A term φ is a product of variables: ``SENSOR`` (its reading, less `centre`, over `scale`), ``abs(SENSOR)``, and
    ``slip(SENSOR)``, −1 to 1: which way a drive last moved, (x − z)/w with z its place after a play of half-width w =
    `slip`. Friction of the whole chain goes by it, at rest too.
    """

    terms: tuple[str, ...] = Field(min_length=1, description="what τ is a sum of; '1' is the constant")
    channels: tuple[str, ...] = Field(min_length=1, description="the sensors, in the estimator's order")
    centre: Row = Field(description="mean of each sensor's readings [SI]")
    scale: Row = Field(description="their standard deviations [SI]; 1 for what was constant")
    low: Row = Field(description="smallest of each [SI]; below it the band grows")
    high: Row = Field(description="largest of each [SI]")
    slip: float = Field(gt=0.0, description="half-width of the plays, in units of `scale`")
    correlation_time: Annotated[float, In("s", "positive")] = Field(description="of what is left")
    spread: Row = Field(
        description="RMS of each joint's torque over the logs [N m]: outside the range so much is not known"
    )
    band: float = Field(1.0, gt=0.0, description="factor on the standard deviation, by the errors on logs left out")
    logs: int = Field(ge=1, description="number of logs")
    joints: tuple[AffineJoint, ...] = Field(
        min_length=1, description="coefficients [N m], covariance and std, one for each joint"
    )

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        m = len(self.channels)
        for name in ("centre", "scale", "low", "high"):
            if len(getattr(self, name)) != m:
                raise ValueError(f"{name} must have {m} entries, one for each channel; {len(getattr(self, name))} came")
        if len(self.spread) != len(self.joints):
            raise ValueError(f"spread must have {len(self.joints)} entries, one for each joint")
        if any(not value > 0.0 for value in self.scale):
            raise ValueError("every scale must be positive")
        if any(not low <= high for low, high in zip(self.low, self.high)):
            raise ValueError("low must not be above high")
        check_terms(self.terms, self.variables, self.joints)
        return self

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of all variables that a term may hold."""
        return tuple(name.format(c) for name in ("{}", "abs({})", "slip({})") for c in self.channels)

    @property
    def slipping(self) -> tuple[int, ...]:
        """Indices of the channels whose last motion is remembered."""
        used = {factor for term in self.terms for factor in factors(term)}
        return tuple(i for i, name in enumerate(self.channels) if f"slip({name})" in used)

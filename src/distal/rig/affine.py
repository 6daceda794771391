"""What least squares learned of a rig: the joints' angles as an affine map of its sensors, and how far to trust it."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from distal.rig.quantities import Description, In

Row = tuple[float, ...]


class AffineJoint(Description):
    """The map of one joint: θ = b0 + Σ b_i (s_i − centre_i)/scale_i + Σ c_j direction_j."""

    joint: str = Field(min_length=1, description="name of the joint")
    coefficients: Row = Field(
        min_length=1,
        description="[rad]: b0, one b for each channel, one c for each position sensor; 0 for what is dropped",
    )
    covariance: tuple[Row, ...] = Field(
        min_length=1,
        description="of the coefficients of the next log about these [rad^2]: between logs, and of the fit",
    )
    std: Annotated[float, In("rad", "positive")] = Field(description="residual with a log's own coefficients")

    @model_validator(mode="after")
    def _covariance_fits(self) -> Self:
        n = len(self.coefficients)
        if len(self.covariance) != n or any(len(row) != n for row in self.covariance):
            raise ValueError(f"covariance must be {n} rows of {n} numbers, as there are {n} coefficients")
        matrix = np.array(self.covariance)
        if not (np.isfinite(matrix).all() and np.isfinite(self.coefficients).all()):
            raise ValueError("coefficients and covariance must be finite numbers")
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix / np.outer(size, size)
        if np.abs(scaled - scaled.T).max() > 1e-6 or np.linalg.eigvalsh(0.5 * (scaled + scaled.T)).min() < -1e-6:
            raise ValueError("covariance must be symmetric and positive semidefinite")
        return self


class Affine(Description):
    """Joints' angles by least squares of what the sensors read (as logged, biases included); `distal fit` writes it."""

    channels: tuple[str, ...] = Field(min_length=1, description="the sensors, in the estimator's order")
    centre: Row = Field(description="mean of each sensor's readings [SI]")
    scale: Row = Field(description="their standard deviation [SI]; 1 for one that was constant")
    low: Row = Field(description="smallest reading of each sensor [SI]")
    high: Row = Field(description="largest reading of each sensor [SI]")
    rate: Row = Field(description="RMS speed of each reading [SI/s]: how fast a missing value loses its worth")
    dead_band: Row = Field(
        description="of each position sensor: motion within ± this does not change its direction [SI]"
    )
    distance: tuple[Row, ...] = Field(
        description="matrix M of the squared Mahalanobis distance zᵀ M z of the readings (s − centre)/scale"
    )
    reach: float = Field(gt=0.0, description="largest such distance in the logs")
    correlation_time: Annotated[float, In("s", "positive")] = Field(description="of the residuals")
    logs: int = Field(ge=0, description="number of logs; 0: from a homing move alone")
    dropped: tuple[str, ...] = Field((), description="sensors that told nothing of their own: constant, or collinear")
    joints: tuple[AffineJoint, ...] = Field(min_length=1, description="one map for each joint")

    @field_validator("scale", mode="after")
    @classmethod
    def _positive(cls, scale: Row) -> Row:
        if any(not value > 0.0 for value in scale):
            raise ValueError("every scale must be positive")
        return scale

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        m = len(self.channels)
        for name in ("centre", "scale", "low", "high", "rate", "distance"):
            if len(getattr(self, name)) != m:
                raise ValueError(f"{name} must have {m} entries, one for each channel; {len(getattr(self, name))} came")
        if any(len(row) != m for row in self.distance):
            raise ValueError(f"distance must be {m} rows of {m} numbers")
        size = 1 + m + len(self.dead_band)
        for joint in self.joints:
            if len(joint.coefficients) != size:
                raise ValueError(
                    f"joint '{joint.joint}': {size} coefficients are needed (1 + {m} channels + {len(self.dead_band)} "
                    f"directions), {len(joint.coefficients)} came"
                )
        if any(not low <= high for low, high in zip(self.low, self.high)):
            raise ValueError("low must not be above high")
        return self

"""Maps that were learned from logs by least squares: coefficients of terms of the sensors'
readings, and the range in which they hold.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from distal.rig.quantities import Description, In

Row = tuple[float, ...]

CONSTANT = "1"
"""Name of the constant term."""

PLAYS = {"play": 1.0, "play3": 3.0, "play9": 9.0, "play27": 27.0}
"""Name of a play operator in a term → its half-width, in half-widths of `LearnedMap.width`: a sum
of them is a Prandtl–Ishlinskii operator. Source: definition (the names).
"""

LAGS = {"lag": 0.05, "lag4": 0.2, "lag16": 0.8}
"""Name of a first-order lag in a term → its time constant [s]. Source: definition (the names)."""

FORMS = ("{}", "abs({})", *(f"{name}({{}})" for name in (*PLAYS, *LAGS)), "slip({})")
"""Forms in which the reading of a sensor may stand in a term; see `LearnedMap`."""


def factors(term: str) -> tuple[str, ...]:
    """Return the variables whose product a term is, by ``*`` between them; the constant
    has none.
    """
    return () if term == CONSTANT else tuple(factor.strip() for factor in term.split("*"))


class JointMap(Description):
    """The map of one joint: Σ b_i φ_i."""

    joint: str = Field(min_length=1, description="name of the joint")
    coefficients: Row = Field(
        min_length=1, description="b, one for each term, in the unit of what is mapped"
    )
    covariance: tuple[Row, ...] = Field(
        min_length=1,
        description="of the coefficients of the next log about these: between logs, and of the fit",
    )
    std: Annotated[float, In("rad", "positive")] = Field(
        description="residual with a log's own coefficients"
    )

    @model_validator(mode="after")
    def _covariance_fits(self) -> Self:
        n = len(self.coefficients)
        if len(self.covariance) != n or any(len(row) != n for row in self.covariance):
            raise ValueError(
                f"covariance must be {n} rows of {n} numbers, as there are {n} coefficients"
            )
        matrix = np.array(self.covariance)
        if not (np.isfinite(matrix).all() and np.isfinite(self.coefficients).all()):
            raise ValueError("coefficients and covariance must be finite numbers")
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        scaled = matrix / np.outer(size, size)
        if (
            np.abs(scaled - scaled.T).max() > 1e-6
            or np.linalg.eigvalsh(0.5 * (scaled + scaled.T)).min() < -1e-6
        ):
            raise ValueError("covariance must be symmetric and positive semidefinite")
        return self


class LearnedMap(Description):
    """A sum Σ b_i φ_i of terms, its variance c² (g² φᵀ C φ + s²), and the range in which
    it was learned; g is `between`.

    A term φ is a product of variables. ``SENSOR`` is the sensor's reading, less `centre`, over
    `scale`; ``abs(SENSOR)`` is its magnitude; ``play(SENSOR)`` is the output z of a play operator
    with half-width w = `width` that follows it; ``play3``, ``play9`` and ``play27`` are the same
    with half-widths 3 w, 9 w and 27 w; ``slip(SENSOR)`` is the direction in which it last moved,
    (SENSOR − z)/w, between −1 and 1. ``lag(SENSOR)``, ``lag4`` and ``lag16`` follow it with the
    time constants of `LAGS`: z⁺ = z + (1 − e^{−dt/T}) (SENSOR − z). ``angle(JOINT)`` is the angle
    of the filter itself, scaled in the same way; it has no such forms.
    """

    MARGIN: ClassVar[float] = np.inf
    """Share of half of the learned range by which terms go on beyond its ends; further out they
    keep the value that they have there.
    """

    FADE: ClassVar[float] = np.inf
    """Distance beyond the end of the learned range, in halves of the range, at which the terms that
    fade have half of their weight.
    """

    terms: tuple[str, ...] = Field(min_length=1, description="what is summed; '1' is the constant")
    channels: tuple[str, ...] = Field(
        min_length=1, description="the sensors, in the estimator's order"
    )
    centre: Row = Field(
        description="mean of each sensor's readings, then of each joint's angle by the filter [SI]"
    )
    scale: Row = Field(description="their standard deviations [SI]; 1 for what was constant")
    low: Row = Field(description="smallest of each [SI]; below it the band grows")
    high: Row = Field(description="largest of each [SI]")
    rate: Row = Field(
        description="RMS speed of each [SI/s]: how fast a missing value loses its worth"
    )
    width: Row = Field(description="half-width of the play of each sensor, in units of `scale`")
    distance: tuple[Row, ...] = Field(
        description="matrix M of the squared Mahalanobis distance zᵀ M z of the sensors' scaled "
        "readings z"
    )
    reach: float = Field(gt=0.0, description="largest such distance in the logs")
    correlation_time: Annotated[float, In("s", "positive")] = Field(description="of what is left")
    tracked: bool = Field(
        True,
        description="whether places of drives are as the filter tracks them; else as their "
        "sensors read them",
    )
    follows: bool = Field(
        False,
        description="whether terms go on beyond the learned range; else they stay as they are "
        "there",
    )
    own: float = Field(
        1.0, ge=0.0, le=1.0, description="share of the filter's own standard deviation that counts"
    )
    between: float = Field(
        1.0,
        gt=0.0,
        le=1.0,
        description="share of the coefficients' standard deviations that counts in the band",
    )
    spread: Row = Field(
        description="RMS over the logs of what is mapped: outside the range so much is not known"
    )
    band: Row = Field(
        description="c, one for each joint: factor on the standard deviation, by logs left out"
    )
    stays: Row = Field(
        (),
        description="for each joint, what adds to the standard deviation after readings were half "
        "a range beyond the learned one, since friction may hold it [SI]",
    )
    moves: tuple[str, ...] = Field(
        (), description="sensors of positions: as they move within the range, that is forgotten"
    )
    apart: tuple[Row, ...] = Field(
        (),
        description="of a blend, for each joint: coefficients of the difference of its members, "
        "whose mean square over a second is normally below 1 in logs left out",
    )
    extrapolation: Row = Field(
        (),
        description="what the angle errs by for each radian beyond what a homing move covered, of "
        "each joint [1]",
    )
    homed: tuple[tuple[float, float], ...] = Field(
        (),
        description="lowest and highest angle that this run's homing move covered, of each joint "
        "[rad]",
    )
    logs: int = Field(ge=0, description="number of logs; 0: from a homing move alone")
    dropped: tuple[str, ...] = Field(
        (), description="sensors that told nothing of their own: constant, or collinear"
    )
    joints: tuple[JointMap, ...] = Field(
        min_length=1, description="coefficients and covariance, one for each joint"
    )

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        m = len(self.channels)
        n = len(self.centre)
        joints = len(self.joints)
        if n not in (m, m + joints):
            raise ValueError(
                f"centre must have {m} entries, one for each channel, or {m + joints} with "
                f"joints; {n} came"
            )
        for name in ("scale", "low", "high", "rate"):
            if len(getattr(self, name)) != n:
                raise ValueError(
                    f"{name} must have {n} entries, as many as centre; {len(getattr(self, name))} "
                    "came"
                )
        for name, size in (("width", m), ("spread", joints), ("band", joints)):
            if len(getattr(self, name)) != size:
                raise ValueError(
                    f"{name} must have {size} entries; {len(getattr(self, name))} came"
                )
        for name in ("stays", "apart", "extrapolation", "homed"):
            if len(getattr(self, name)) not in (0, joints):
                raise ValueError(
                    f"{name} must have {joints} entries or none; {len(getattr(self, name))} came"
                )
        unknown = [name for name in self.moves if name not in self.channels]
        if unknown:
            raise ValueError(f"moves: '{unknown[0]}' is none of channels")
        if len(self.distance) != m or any(len(row) != m for row in self.distance):
            raise ValueError(f"distance must be {m} rows of {m} numbers")
        are_positive = all(size > 0.0 for size in (*self.scale, *self.width, *self.band))
        if not are_positive or not np.isfinite(self.scale).all():
            raise ValueError("every scale, width and band must be positive")
        if any(not low <= high for low, high in zip(self.low, self.high)):
            raise ValueError("low must not be above high")
        for term in self.terms:
            for factor in factors(term):
                if factor not in self.variables:
                    raise ValueError(
                        f"terms: '{factor}' is no variable ({', '.join(self.variables)})"
                    )
        for joint in self.joints:
            if len(joint.coefficients) != len(self.terms):
                raise ValueError(
                    f"joint '{joint.joint}': {len(self.terms)} coefficients are needed, one for "
                    "each term, "
                    f"{len(joint.coefficients)} came"
                )
        if any(len(row) != len(self.terms) for row in self.apart):
            raise ValueError(f"apart: each row must have {len(self.terms)} coefficients")
        return self

    @property
    def structure(self) -> tuple[object, ...]:
        """What decides the equations of the map; all else is a number in them."""
        sizes = (len(self.centre), len(self.joints))
        flags = (self.tracked, self.follows, bool(self.stays), bool(self.apart))
        return type(self).__name__, self.terms, self.channels, self.moves, *sizes, *flags

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of all variables that a term of the map may hold."""
        angles = [f"angle({joint.joint})" for joint in self.joints] if self.uses_angles else []
        return (*(form.format(name) for form in FORMS for name in self.channels), *angles)

    @property
    def margin(self) -> float:
        """Share of half of the learned range by which the map's terms go on beyond its ends."""
        return np.inf if self.follows else self.MARGIN

    @property
    def fading(self) -> tuple[bool, ...]:
        """Whether each term fades beyond the learned range: products of variables, which no log
        constrains there; with them also other terms that do not go on, but not the constant.
        """
        products = [len(factors(term)) > 1 for term in self.terms]
        all_fade = any(products) and np.isfinite(self.margin)
        return tuple(
            is_product or (all_fade and term != CONSTANT)
            for is_product, term in zip(products, self.terms)
        )

    @property
    def fades_over(self) -> float:
        """Distance beyond the learned range, in halves of it, at which terms that fade have half of
        their weight; infinite where none does.
        """
        return self.FADE if any(self.fading) else np.inf

    @property
    def uses_angles(self) -> bool:
        """Whether the filter's own angles may stand in the map's terms."""
        return len(self.centre) > len(self.channels)

    @property
    def used(self) -> tuple[int, ...]:
        """Indices of the readings, then of the angles, that stand in some term of the map."""
        used = {factor for term in self.terms for factor in factors(term)}
        variables = [{form.format(name) for form in FORMS} for name in self.channels]
        variables += (
            [{f"angle({joint.joint})"} for joint in self.joints] if self.uses_angles else []
        )
        return tuple(i for i, names in enumerate(variables) if used & names)

    @property
    def played(self) -> tuple[tuple[int, float], ...]:
        """The play operators that the map's terms need: index of the channel, and half-width in
        half-widths of `width`.
        """
        used = {factor for term in self.terms for factor in factors(term)}
        return tuple(
            (i, ratio)
            for i, name in enumerate(self.channels)
            for play, ratio in PLAYS.items()
            if f"{play}({name})" in used or (ratio == 1.0 and f"slip({name})" in used)
        )

    @property
    def lagged(self) -> tuple[tuple[int, float], ...]:
        """The first-order lags that the map's terms need: index of the channel, and time constant
        [s].
        """
        used = {factor for term in self.terms for factor in factors(term)}
        return tuple(
            (i, constant)
            for i, name in enumerate(self.channels)
            for lag, constant in LAGS.items()
            if f"{lag}({name})" in used
        )


class Affine(LearnedMap):
    """Joints' angles by least squares of what the sensors read (as logged, biases included);
    `distal fit` writes it.
    """

    FADE: ClassVar[float] = 0.25


class Discrepancy(LearnedMap):
    """The joints' angles less what `adaptive` makes of them (Kennedy and O'Hagan, 2001); `distal
    fit` writes it.
    """

    MARGIN: ClassVar[float] = 0.5
    FADE: ClassVar[float] = 0.25


class Contact(LearnedMap):
    """The torque on the joints from outside, of what is read at the proximal end; `distal fit`
    writes it.
    """

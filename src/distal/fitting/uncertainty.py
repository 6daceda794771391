"""What logs can tell: standard errors, correlations, and what they leave to the prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distal.fitting.free import Free
from distal.fitting.likelihood import Derivatives

Floats = NDArray[np.float64]

IDENTIFIED = 0.9
"""A parameter whose standard error is above this share of its prior's std is not identified by the logs."""

VAGUE = 0.5
"""The same for one without a prior: standard error as a share of its value."""

WEAK = 0.5
"""A combination of which the logs tell less than this share of what the priors do is said."""

PART = 0.3
"""A parameter belongs to a combination if its share in it is at least this."""


@dataclass(frozen=True)
class Uncertainty:
    """How well a fit is known.

    Args:
        covariance: of the coordinates' errors, (n, n): H⁻¹ (J + P) H⁻¹ with H = I + P, I Fisher's information, P the
            prior's and J the long-run covariance of the scores, but no less than H⁻¹; what is `Free.coarse` added.
        identified: whether the logs say more of each coordinate than its prior, (n,).
        combinations: plain lines on combinations that the logs do not tell.
    """

    covariance: Floats
    identified: tuple[bool, ...]
    combinations: tuple[str, ...]

    @property
    def errors(self) -> Floats:
        """Standard errors of the coordinates, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Floats:
        """Correlations of the coordinates' errors, (n, n)."""
        errors = np.maximum(self.errors, 1e-300)
        correlations: Floats = self.covariance / np.outer(errors, errors)
        return correlations


def uncertainty_at(derivatives: Derivatives, z: Floats, parts: Sequence[tuple[Free, int | None]]) -> Uncertainty:
    """Return standard errors and what stays unknown at the end of a fit.

    Args:
        derivatives: of −ln p there.
        z: coordinates, (n,).
        parts: the free parameter behind each coordinate.
    """
    n = len(z)
    # a very wide prior keeps what neither logs nor priors know from dividing by zero
    hessian = derivatives.information + derivatives.prior + 1e-12 * np.eye(n)
    inverse = np.linalg.pinv(hessian, hermitian=True)
    # few spans of time tell too small a variance (MacKinnon and White, J. Econometrics 29, 1985)
    few = derivatives.spans / max(derivatives.spans - n, 1)
    sandwich = inverse @ (few * derivatives.meat + derivatives.prior) @ inverse
    covariance = np.where(np.eye(n) > 0, np.maximum(np.diag(sandwich), np.diag(inverse)), 0.0)
    scale = np.sqrt(np.diag(covariance) / np.maximum(np.diag(inverse), 1e-300))
    covariance = inverse * np.outer(scale, scale)
    numeric = [part.coarse * abs(part.value(c)) / max(part.slope(c), 1e-300) for (part, _), c in zip(parts, z)]
    covariance += np.diag(np.square(numeric))
    # what is known after a log is no less than what was known before it
    limit = np.array([part.spread if part.has_prior else np.inf for part, _ in parts])
    shrink = np.minimum(1.0, limit / np.maximum(np.sqrt(np.diag(covariance)), 1e-300))
    covariance *= np.outer(shrink, shrink)
    identified = []
    for (part, _), coordinate, error in zip(parts, z, np.sqrt(np.diag(covariance))):
        known = (
            part.spread if part.has_prior else VAGUE * abs(part.value(coordinate)) / max(part.slope(coordinate), 1e-300)
        )
        identified.append(bool(error < (IDENTIFIED if part.has_prior else 1.0) * known))
    return Uncertainty(covariance, tuple(identified), _combinations(derivatives, z, parts))


def _combinations(derivatives: Derivatives, z: Floats, parts: Sequence[tuple[Free, int | None]]) -> tuple[str, ...]:
    """Return lines on directions that the logs say less of than the priors, each over two parameters or more."""
    own = [k for k, (part, _) in enumerate(parts) if not part.noise]
    if len(own) < 2:
        return ()
    yardstick = np.array(
        [
            parts[k][0].spread
            if parts[k][0].has_prior
            else VAGUE * abs(parts[k][0].value(z[k])) / max(parts[k][0].slope(z[k]), 1e-300)
            for k in own
        ]
    )
    relative = derivatives.information[np.ix_(own, own)] * np.outer(yardstick, yardstick)
    amounts, directions = np.linalg.eigh((relative + relative.T) / 2)
    lines = []
    for amount, direction in zip(amounts, directions.T):
        members = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) >= PART]
        if amount < WEAK and len(members) > 1:
            lines.append(_line([parts[own[i]][0] for i in members], [z[own[i]] for i in members], direction[members]))
    return tuple(lines)


SUMMANDS = {"constant", "load", "preload"}
"""Parts of one friction limit, which add up."""


def _line(parts: Sequence[Free], z: Sequence[float], direction: Floats) -> str:
    """Return "a and b only as a product", by the signs of the relative changes that no log tells apart."""
    names = [part.name for part in parts]
    changes = [
        step * part.slope(at) * (part.spread if part.has_prior else 1.0) / (part.value(at) or 1.0)
        for part, at, step in zip(parts, z, direction)
    ]
    if len(parts) == 2:
        kind = "as a product" if changes[0] * changes[1] < 0 else "as a ratio"
        if {part.name.rpartition(".")[2] for part in parts} <= SUMMANDS:
            kind = "as a sum"
        return f"{names[0]} and {names[1]} only {kind}: turn the joint further, or vary the load"
    return f"{', '.join(names[:-1])} and {names[-1]} only together: turn the joint further, or vary the load"

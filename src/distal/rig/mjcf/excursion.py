"""Lengths of tendons: the polynomial of lowest degree in the joints' angles that gives their
change.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import comb

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats

ENOUGH = 0.01
"""A polynomial is accepted where its RMS error of each moment arm, over poses to which it was not
fitted, is at most this share of the largest arm [1]. Source: judgement.
"""

HIGHEST_DEGREE = 5
"""Highest degree of polynomials that are tried [1]. Source: judgement."""

MOST_TERMS = 252
"""Largest number of terms, with the constant, of polynomials that are tried [1]: those of degree 5
in five joints. Time and memory grow with its square. Source: definition.
"""

NEARLY = 1.25
"""Where no degree reaches `ENOUGH`, the lowest one and the fewest terms are taken whose error is at
most so many times the least one [1]. Source: judgement.
"""


@dataclass(frozen=True)
class Excursion:
    """How the length of a tendon changes with the angles of joints: Σ c Π θ_j^{n_j}.

    Args:
        powers: n_j of each term, (n_terms, n_joints).
        coefficients: c of each term, (n_terms,).
        length_rms: RMS error of the length, over poses to which the polynomial was not fitted.
        arm_rms: RMS error of each joint's moment arm over these poses, as a share of the largest
            arm, (n_joints,).
        arm_most: below this share are 92 % of the errors of the worst joint's moment arm on these
            poses, and about 90 % on further poses.
    """

    powers: NDArray[np.int64]
    coefficients: Floats
    length_rms: float
    arm_rms: Floats
    arm_most: float

    @property
    def degree(self) -> int:
        """The degree of the polynomial, its highest sum of powers."""
        return int(self.powers.sum(axis=1).max())


def fit_excursion(angles: Floats, lengths: Floats, arms: Floats) -> Excursion:
    """Return the polynomial of lowest degree that reaches `ENOUGH`; where none does, the lowest
    that is nearly the best.

    Lengths and moment arms are fitted together, each as a share of its size, by least squares. Then
    only the terms that the accuracy needs are kept: one by one, the term that explains most of what
    is left is taken (orthogonal matching pursuit: Pati, Rezaiifar, Krishnaprasad, Asilomar 1993).

    Args:
        angles: of the joints that the tendon crosses [rad], (k, n_joints).
        lengths: of the tendon, less the length with all of these joints at zero, (k,).
        arms: ∂length/∂angle, (k, n_joints).
    """
    fits = list[Excursion]()
    joints = angles.shape[1]
    for degree in range(1, HIGHEST_DEGREE + 1):
        if comb(joints + degree, degree) > MOST_TERMS:
            break
        fits.append(_fitted(_powers(joints, degree), angles, lengths, arms))
        if fits[-1].arm_rms.max() <= ENOUGH:
            return _shortened(fits[-1], ENOUGH, angles, lengths, arms)
    least = min(fit.arm_rms.max() for fit in fits)
    lowest = next(fit for fit in fits if fit.arm_rms.max() <= NEARLY * least)
    return _shortened(lowest, NEARLY * least, angles, lengths, arms)


def _shortened(
    full: Excursion, enough: float, angles: Floats, lengths: Floats, arms: Floats
) -> Excursion:
    """Return a polynomial with as few terms as leave no more than `enough` of each moment arm."""
    rows, desired = _equations(full.powers, angles, lengths, arms)
    directions = rows / np.linalg.norm(rows, axis=0)
    gram = directions.T @ directions
    explained = desired @ directions
    chosen = list[int]()
    left = explained
    while len(chosen) < len(full.powers):
        gains = np.abs(left)
        gains[chosen] = -1.0
        chosen.append(int(gains.argmax()))
        weights = np.linalg.lstsq(gram[np.ix_(chosen, chosen)], explained[chosen], rcond=None)[0]
        left = explained - gram[:, chosen] @ weights
        # with a joint that has no term the error is too large in any case
        if np.all(full.powers[chosen].any(axis=0)):
            shorter = _fitted(full.powers[sorted(chosen)], angles, lengths, arms)
            if shorter.arm_rms.max() <= enough:
                return shorter
    return full


def _powers(joints: int, degree: int) -> NDArray[np.int64]:
    products = [
        chosen
        for d in range(1, degree + 1)
        for chosen in combinations_with_replacement(range(joints), d)
    ]
    return np.array([np.bincount(chosen, minlength=joints) for chosen in products])


def _terms(angles: Floats, powers: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return values, (k, n_terms), and slopes of the terms, (k, n_joints, n_terms)."""
    raised = angles[:, None, :] ** powers[None]
    slopes = []
    for j in range(angles.shape[1]):
        cofactors = np.prod(np.delete(raised, j, axis=2), axis=2)
        slopes.append(
            cofactors * powers[:, j] * angles[:, j, None] ** np.maximum(powers[:, j] - 1, 0)
        )
    return np.prod(raised, axis=2), np.stack(slopes, axis=1)


def _equations(
    powers: NDArray[np.int64], angles: Floats, lengths: Floats, arms: Floats
) -> tuple[Floats, Floats]:
    """Return rows and right sides of the least squares: lengths and moment arms of every second
    pose; the others judge the fit.
    """
    size = np.abs(arms).max(axis=0)
    span = max(float(np.ptp(lengths)), 1e-12)
    values, slopes = _terms(angles[::2], powers)
    rows = np.vstack([values / span, *(slopes[:, j] / size[j] for j in range(len(size)))])
    return rows, np.concatenate(
        [lengths[::2] / span, *(arms[::2, j] / size[j] for j in range(len(size)))]
    )


def _fitted(powers: NDArray[np.int64], angles: Floats, lengths: Floats, arms: Floats) -> Excursion:
    rows, desired = _equations(powers, angles, lengths, arms)
    coefficients: Floats = np.linalg.lstsq(rows, desired, rcond=None)[0].astype(np.float64)
    values, slopes = _terms(angles[1::2], powers)
    left: Floats = np.abs(np.einsum("kjt,t->kj", slopes, coefficients) - arms[1::2]) / np.abs(
        arms
    ).max(axis=0)
    off = values @ coefficients - lengths[1::2]
    return Excursion(
        powers,
        coefficients,
        float(np.sqrt(np.mean(off**2))),
        np.sqrt(np.mean(left**2, axis=0)),
        float(np.quantile(left, 0.92, axis=0).max()),
    )

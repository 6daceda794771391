"""The lowest polynomial in the joints' angles that says how a tendon's length changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats

ENOUGH = 0.01
"""A polynomial is taken where it leaves less of each moment arm than this, as RMS over poses that
it was not made with.
"""

HIGHEST_DEGREE = 5

NEARLY = 1.25
"""A higher degree that leaves no less than the lower one's error divided by this is not worth its
terms.
"""

SHORTER = 1.02
"""A shorter polynomial may leave so much more than the whole one where that does not reach
`ENOUGH`.
"""

KEPT_OUT = 3
"""One pose in so many is kept to judge by."""


@dataclass(frozen=True)
class Excursion:
    """How the length of a tendon changes with the angles of joints: Σ c Π θ_j^{n_j}.

    Args:
        powers: n_j of each term, (n_terms, n_joints).
        coefficients: c of each term.
        length_rms: what it leaves of the length, RMS over poses that it was not made with.
        arm_rms: what it leaves of each joint's moment arm, as a share of the largest, RMS.
        arm_most: the same, but what 92 % of the poses stay below, of the worst joint: on others it
            is then 90 %.
    """

    powers: NDArray[np.int64]
    coefficients: Floats
    length_rms: float
    arm_rms: Floats
    arm_most: float

    @property
    def degree(self) -> int:
        """The highest sum of powers."""
        return int(self.powers.sum(axis=1).max())


def fit_excursion(angles: Floats, lengths: Floats, arms: Floats) -> Excursion:
    """Return the lowest polynomial that reaches `ENOUGH`; where none does, the lowest that is
    nearly the best.

    Lengths and moment arms are fitted together, each as a share of its size, by least squares. Of
    the terms of a degree, those are taken that are needed for this: each time the one that explains
    most of what is left (orthogonal matching pursuit: Pati, Rezaiifar, Krishnaprasad, Asilomar
    1993).

    Args:
        angles: of the joints that the tendon crosses [rad], (k, n_joints).
        lengths: of the tendon less that with all of these at zero, (k,).
        arms: ∂length/∂angle, (k, n_joints).
    """
    fits = list[Excursion]()
    for degree in range(1, HIGHEST_DEGREE + 1):
        fits.append(_fitted(_powers(angles.shape[1], degree), angles, lengths, arms))
        if fits[-1].arm_rms.max() <= ENOUGH:
            return _shortened(fits[-1], ENOUGH, angles, lengths, arms)
    least = min(fit.arm_rms.max() for fit in fits)
    lowest = next(fit for fit in fits if fit.arm_rms.max() <= NEARLY * least)
    return _shortened(lowest, SHORTER * lowest.arm_rms.max(), angles, lengths, arms)


def _shortened(
    full: Excursion, enough: float, angles: Floats, lengths: Floats, arms: Floats
) -> Excursion:
    """Return a polynomial with as few terms as leave no more than `enough` of each moment arm."""
    rows, desired = _equations(full.powers, angles, lengths, arms)
    directions = rows / np.linalg.norm(rows, axis=0)
    chosen = list[int]()
    left = desired
    while len(chosen) < len(full.powers):
        gains = np.abs(left @ directions)
        gains[chosen] = -1.0
        chosen.append(int(gains.argmax()))
        left = desired - rows[:, chosen] @ np.linalg.lstsq(rows[:, chosen], desired, rcond=None)[0]
        # a joint without a term has all of its moment arm left: no need to fit anew
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


def _judged(angles: Floats) -> Bools:
    """Return which poses are kept to judge by."""
    judged: Bools = np.arange(len(angles)) % KEPT_OUT == 0
    return judged


def _equations(
    powers: NDArray[np.int64], angles: Floats, lengths: Floats, arms: Floats
) -> tuple[Floats, Floats]:
    """Return rows and right sides of the least squares: lengths and moment arms of the poses that
    are not kept.
    """
    used = ~_judged(angles)
    size = np.abs(arms).max(axis=0)
    span = max(float(np.ptp(lengths)), 1e-12)
    values, slopes = _terms(angles[used], powers)
    rows = np.vstack([values / span, *(slopes[:, j] / size[j] for j in range(len(size)))])
    return rows, np.concatenate(
        [lengths[used] / span, *(arms[used, j] / size[j] for j in range(len(size)))]
    )


def _fitted(powers: NDArray[np.int64], angles: Floats, lengths: Floats, arms: Floats) -> Excursion:
    rows, desired = _equations(powers, angles, lengths, arms)
    coefficients: Floats = np.linalg.lstsq(rows, desired, rcond=None)[0].astype(np.float64)
    judged = _judged(angles)
    values, slopes = _terms(angles[judged], powers)
    left: Floats = np.abs(np.einsum("kjt,t->kj", slopes, coefficients) - arms[judged]) / np.abs(
        arms
    ).max(axis=0)
    off = values @ coefficients - lengths[judged]
    return Excursion(
        powers,
        coefficients,
        float(np.sqrt(np.mean(off**2))),
        np.sqrt(np.mean(left**2, axis=0)),
        float(np.quantile(left, 0.92, axis=0).max()),
    )


def sizes(names: Sequence[str], shares: Floats) -> str:
    """Return the shares that are left of each joint's moment arm in words."""
    return ", ".join(f"{100 * share:.2g} % at {name}" for name, share in zip(names, shares))

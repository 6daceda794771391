"""Blends: a filter's corrected angle and that of the affine map, weighted by their errors on
held-out logs (Wolpert, Neural Networks 5, 1992; Yao et al., Bayesian Analysis 13, 2018).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from distal.arrays import Floats
from distal.regression.affine import less_the_angle
from distal.regression.band import Errors, rms_beyond_noise
from distal.regression.cross_validation import splits
from distal.regression.features import Samples
from distal.regression.learn_map import (
    HeldOut,
    Kind,
    Terms,
    choose_terms,
    errors_of,
    fit_coefficients,
)
from distal.regression.random_effects import joint_map, row_of
from distal.rig import CONSTANT, JointMap, LearnedMap

WITHOUT_ERRORS = 0.5
"""Weight of each member where a single log teaches, which tells no weights. Source: judgement."""


@dataclass(frozen=True)
class Blend:
    """The two members of a blend, as maps of the error δ of a filter's angle θ.

    Args:
        kind: maps of δ from the readings as logged and the filter's own angles.
        correction: terms of the member θ + φᵀ b, without plays.
        line: terms of the member φᵀ b, which needs no filter.
        follows: whether both members' terms go on beyond the range of the logs; else the angle
            moves there as the filter's does.
    """

    kind: Kind
    correction: Terms
    line: Terms
    follows: bool

    @classmethod
    def of(cls, samples: Sequence[Samples], kind: Kind, line: Terms, folds: Sequence[int]) -> Blend:
        """Return the blend of a line with the linear correction that errs least on held-out logs.

        The terms go on beyond the range of the logs where the line then errs less on held-out
        logs.
        """
        plain = {CONSTANT, *kind.channels, *(f"angle({joint})" for joint in kind.joints)}
        linear = replace(kind, sets=tuple(terms for terms in kind.sets if {*terms.terms} <= plain))
        correction = choose_terms(samples, linear, folds, None)
        alike = replace(correction, width=line.width, of_noise=line.of_noise)
        ways = [cls(kind, alike, line, follows) for follows in (False, True)]
        return min(ways, key=lambda way: rms_beyond_noise(way._errors(samples, folds)[1]))

    def learned(self, logs: Sequence[Samples], folds: Sequence[int]) -> LearnedMap:
        """Return the blend that logs teach, with the `weights` that these logs tell.

        Raises:
            FitError: for some joint no log has more samples with a known angle than there are
                terms.
        """
        return _mixed(*self._members(logs), self.weights(logs, folds))

    def weights(self, logs: Sequence[Samples], folds: Sequence[int]) -> list[float]:
        """Return the weight of the line for each joint, by the errors of both members on the logs
        of each fold, which the other folds' logs teach.
        """
        correction, line = self._errors(logs, folds)
        return [
            _weight([(first[j][0], second[j][0]) for first, second in zip(correction, line)])
            for j in range(len(self.kind.joints))
        ]

    def held_out(self, logs: Sequence[Samples], folds: Sequence[int]) -> list[HeldOut]:
        """Return each log after the blend that the logs of the other folds teach, weights
        included.
        """
        held = list[HeldOut]()
        for out, left in splits(folds):
            learned = self.learned([logs[i] for i in left], [folds[i] for i in left])
            held += [(learned, logs[i]) for i in out]
        return held

    def _errors(
        self, logs: Sequence[Samples], folds: Sequence[int]
    ) -> tuple[list[list[Errors]], list[list[Errors]]]:
        """Return the errors on held-out logs of the correction and of the line."""
        errors = list[list[Errors]](), list[list[Errors]]()
        for out, left in splits(folds) if len(set(folds)) > 1 else ():
            members = self._members([logs[i] for i in left])
            for member, its_errors in zip(members, errors):
                its_errors += [errors_of(member, logs[i], self.kind, None) for i in out]
        return errors

    def _members(self, logs: Sequence[Samples]) -> tuple[LearnedMap, LearnedMap]:
        """Return the maps of δ of the correction and of the line, whose value is φᵀ b − θ."""
        angles = [replace(log, targets=log.targets + log.angles) for log in logs]
        line = fit_coefficients(angles, self.kind, self.line)
        correction = fit_coefficients(logs, self.kind, self.correction)
        as_logged = {"tracked": False, "follows": self.follows}
        return correction.model_copy(update=as_logged), less_the_angle(line).model_copy(
            update=as_logged
        )


def _weight(errors: Sequence[tuple[Floats, Floats]]) -> float:
    """Return the weight w of the second member, 0 ≤ w ≤ 1, for which the mean over logs of the mean
    of ((1 − w) e₁ + w e₂)² is least, e₁ and e₂ being the members' errors on held-out logs.
    """
    apart = sum(float(np.mean((e1 - e2) ** 2)) for e1, e2 in errors if len(e1))
    common = sum(float(np.mean(e1 * (e1 - e2))) for e1, e2 in errors if len(e1))
    return float(np.clip(common / apart, 0.0, 1.0)) if apart > 0.0 else WITHOUT_ERRORS


def _mixed(first: LearnedMap, second: LearnedMap, weights: Sequence[float]) -> LearnedMap:
    """Return the map (1 − w) φᵀ b₁ + w φᵀ b₂ with a weight w for each joint.

    Its variance is that of a mixture, (1 − w) v₁ + w v₂ + w (1 − w) (φᵀ b₁ − φᵀ b₂)², so that the
    band grows where the members disagree.
    """
    terms = tuple(dict.fromkeys((*first.terms, *second.terms)))
    joints = []
    apart = list[tuple[float, ...]]()
    for correction, line, w in zip(first.joints, second.joints, weights):
        b1, c1 = _among(first, correction, terms)
        b2, c2 = _among(second, line, terms)
        apart.append(row_of(b1 - b2))
        covariance = (1 - w) * c1 + w * c2 + w * (1 - w) * np.outer(apart[-1], apart[-1])
        std = float(np.sqrt((1 - w) * correction.std**2 + w * line.std**2))
        joints.append(joint_map(correction.joint, (1 - w) * b1 + w * b2, covariance, std))
    stays = [sqrt((1 - w) * a**2 + w * b**2) for w, a, b in zip(weights, first.stays, second.stays)]
    longest = max(first.correlation_time, second.correlation_time)
    return first.model_copy(
        update={
            "terms": terms,
            "joints": tuple(joints),
            "correlation_time": longest,
            "stays": tuple(stays),
            "apart": tuple(apart),
        }
    )


def _among(learned: LearnedMap, joint: JointMap, terms: Sequence[str]) -> tuple[Floats, Floats]:
    """Return a joint's coefficients, (n,), and their covariance, (n, n), for more terms."""
    columns = [terms.index(term) for term in learned.terms]
    coefficients = np.zeros(len(terms))
    covariance = np.zeros((len(terms), len(terms)))
    coefficients[columns] = joint.coefficients
    covariance[np.ix_(columns, columns)] = joint.covariance
    return coefficients, covariance

"""Causes of an error at one drive, found with reference angles, and which of them explains most.

With the joints' true angles the position of a drive needs no filter:  s = σ (Σ_j c_j g_j(θ_j) + c_F
F/K − F_0/K) + a + f d − τ ds/dt.  Here g_j is the position that joint j alone asks of the drive, F
its measured pull, F_0 the pull of pre-tension, K its tendons' stiffness, and d the direction of
motion. A right rig has the scale σ = 1, the factors c = 1, the zero a = 0 and the delay τ = 0; f is
friction. All of these are estimated together, with the rig's own stds as priors (ridge regression).
A cause is one of these changes, freed from its prior; the likeliest cause has the largest gain in
ln p.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from distal.arrays import Floats
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.explanations import UNIT_FACTORS
from distal.diagnosis.rerun import ModelChange
from distal.rig import Sensor

BEYOND = 3.0
"""Change, in the rig's own stds, from which on it contradicts the rig, even where a wide band
contains the truth [1]. Source: judgement.
"""

LEAST_GAIN = 2.0
"""Least gain in −2 ln p of a cause, where the truth contradicts, so that something is wrong [1].
Source: reference (Kass and Raftery, J. American Statistical Association 90, 1995: above 2 is
positive evidence).
"""

SIGN_OF_FORCE = 10.0
"""Factor by which the gain of a wrong sign of a force has to be larger [1]: a pull that rises with
the angle looks like a gear. Source: judgement.
"""

ALIKE = 0.15
"""Difference of the logarithms of a factor and that of a unit, below which the factor is that unit
[1]. Source: judgement.
"""

MOST = 2
"""Number of causes that are named. Source: layout."""


ROUNDS = 8
"""Number of rounds in which the variance of the residual, and with it the weight of the priors, is
found. Source: judgement.
"""


@dataclass(frozen=True, eq=False)
class Cause:
    """A change of a sensor, a drive or a parameter that would explain an error.

    Args:
        subject: what is changed, by name.
        kind: "scale", "arm", "force", "stiffness", "delay", "zero", "friction" or "swap".
        values: column of the regression: effect of a change of 1 on the residual, (k,).
        std: how well the rig knows it, in the unit of its change.
        change: that was found; of a factor, the factor minus 1.
        size: by how much it moves the angle [rad].
        gain: in −2 ln p, with Cauchy's prior of the change.
        paths: parameters of the rig that stand for it, if any.
        sensor: of the drive's position, if the cause is of one drive.
    """

    subject: str
    kind: str
    values: Floats
    std: float = 0.0
    change: float = 0.0
    size: float = 0.0
    gain: float = 0.0
    paths: tuple[str, ...] = ()
    sensor: Sensor | None = None

    @property
    def words(self) -> str:
        """What the subject looks like, for a finding."""
        return _words(self)

    @property
    def units(self) -> list[float]:
        """Factors of the units in which a force may be read, and −1 for a wrong sign."""
        assert self.sensor is not None
        unit = _unit_of_force(self.sensor)
        return [factor for factor, words in UNIT_FACTORS.items() if unit in words or "" in words]

    @property
    def unlikely(self) -> float:
        """Distance of the change from what the rig says, in stds; of a factor, in logarithms."""
        if self.kind == "swap":
            return BEYOND
        if self.kind in ("zero", "delay"):
            return abs(self.change) / self.std
        factor = 1.0 + self.change
        turned = BEYOND if factor < 0.0 else 0.0
        return float(np.hypot(np.log(max(abs(factor), 1e-6)) / self.std, turned))

    @property
    def undone(self) -> list[ModelChange]:
        """Changes of readings or of parameters, each of which removes the cause."""
        factor = 1.0 + self.change
        if self.kind == "zero":
            return [ModelChange(added={self.subject: -self.change})]
        if self.kind == "delay":
            return [ModelChange(later={self.subject: self.change})]
        if self.kind == "swap":
            return [ModelChange(exchanged=tuple(self.subject.split(" and ")))]
        if factor == 0.0:
            return []
        if self.kind in ("arm", "friction"):
            return [ModelChange(parameters=dict.fromkeys(self.paths, factor))]
        is_position = self.kind == "scale"
        reading = ModelChange(channels={self.subject: 1 / factor if is_position else factor})
        if not self.paths or factor < 0.0:
            return [reading]
        number = factor if is_position else 1 / factor
        return [reading, ModelChange(parameters=dict.fromkeys(self.paths, number))]

    @property
    def beyond(self) -> bool:
        """Whether the change contradicts the rig: columns are exchanged, or a scale or an arm is
        more than `BEYOND` stds away.

        A force has friction in it, and a zero takes up errors of force and stiffness: these differ
        in a right rig too.
        """
        if self.kind == "swap":
            return True
        if self.kind not in ("scale", "arm"):
            return False
        return self.change <= -1 or bool(abs(np.log1p(self.change)) > BEYOND * self.std)


class _Fit(NamedTuple):
    """Changes by ridge regression, the residual that they leave, and −2 ln p with the priors."""

    changes: Mapping[Cause, float]
    left: Floats
    cost: float


@dataclass(frozen=True, eq=False)
class DriveResidual:
    """Residual of the position of a drive beside the reference angles, and the causes that may
    explain it.

    Args:
        sensor: of the position.
        residual: measured minus expected position, at the samples where all is known, (k,) [m,
            rad].
        causes_tried: each with its column and its prior std.
        nuisances: columns of what is never known, with their prior stds.
        count: number of independent samples.
        lever: position per angle of the joint that turns the drive most [m/rad, 1].
    """

    sensor: Sensor
    residual: Floats
    causes_tried: tuple[Cause, ...]
    nuisances: tuple[tuple[Floats, float], ...]
    count: float
    lever: float

    def fit(self, free: Sequence[Cause] = ()) -> _Fit:
        """Return the estimated changes of all causes; those in `free` have Cauchy's prior instead
        of their own.

        A delay takes part only if it is in `free`.
        """
        tried = [each for each in self.causes_tried if each.kind != "delay" or each in free]
        columns = [each.values for each in tried] + [values for values, _ in self.nuisances]
        stds = [np.inf if each in free else each.std for each in tried]
        stds += [std for _, std in self.nuisances]
        matrix = np.column_stack(columns)
        residual = self.residual
        scales = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
        scaled = matrix / scales
        precision = 1.0 / (np.array(stds) * scales) ** 2
        least = 1e-12 * float(np.mean(residual**2)) + 1e-30
        variance = float(np.mean(residual**2)) + least
        for _ in range(ROUNDS):
            weight = self.count / len(residual) / variance
            information = weight * scaled.T @ scaled + np.diag(precision)
            information += 1e-12 * np.diag(np.diag(information))
            changes = np.linalg.solve(information, weight * scaled.T @ residual)
            left = residual - scaled @ changes
            variance = float(np.mean(left**2)) + least
        cost = self.count * np.log(variance) + float(precision @ changes**2)
        found = dict(zip(tried, (changes / scales).tolist()))
        for each in free:
            # Cauchy's prior of a free cause: of two that explain the same, the one nearer to the
            # rig is likelier
            cost += 2.0 * float(np.log1p((found[each] / max(each.std, 1e-12)) ** 2))
        return _Fit(found, left, cost)

    def causes(self) -> list[Cause]:
        """Return the cause that gains most, and a second one if it gains enough beside it."""
        free = list[Cause]()
        found = list[Cause]()
        before = self.fit()
        for _ in range(MOST):
            fits = {each: self.fit([*free, each]) for each in self.causes_tried if each not in free}
            gains = {each: self._gain(each, before, fit) for each, fit in fits.items()}
            best = max(gains, key=lambda each: gains[each])
            if gains[best] < LEAST_GAIN:
                break
            free.append(best)
            before = fits[best]
            found.append(replace(best, gain=gains[best]))
        return [self._named(*pair) for pair in zip(found, self._sizes(free))]

    def alone(self) -> list[Cause]:
        """Return every cause with the change that it has as the only one."""
        return [self._named(each, self._sizes([each])[0]) for each in self.causes_tried]

    def _sizes(self, free: Sequence[Cause]) -> Floats:
        """Return the changes of causes by least squares with a free zero: priors would make them
        smaller.
        """
        if not free:
            return np.zeros(0)
        columns = [each.values for each in free]
        if all(each.kind != "zero" for each in free):
            columns.append(np.ones(len(self.residual)))
        matrix = np.column_stack(columns)
        scales = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        changes: Floats = np.linalg.lstsq(matrix / scales, self.residual, rcond=1e-9)[0] / scales
        return changes[: len(free)]

    def _gain(self, cause: Cause, before: _Fit, after: _Fit) -> float:
        """Return the gain in −2 ln p where a cause is free.

        The gain of a delay counts half, since a delay is often alike to the motion itself. The gain
        of a wrong sign of a force is divided by `SIGN_OF_FORCE`, since friction in a force acts
        against the stretch.
        """
        gain = before.cost - after.cost
        if cause.kind == "delay":
            return gain / 2.0
        if cause.kind in ("force", "stiffness") and after.changes[cause] < -1.0:
            return gain / SIGN_OF_FORCE
        return gain

    def _named(self, cause: Cause, change: float) -> Cause:
        size = abs(change) * float(np.sqrt(np.mean(cause.values**2))) / self.lever
        return replace(cause, change=float(change), size=size)


def _words(cause: Cause) -> str:
    """Return what the subject of a cause looks like."""
    factor = 1.0 + cause.change
    if cause.kind == "swap":
        return "swapped"
    if cause.kind == "delay":
        return texts.like_a_delay(cause.change)
    if cause.kind == "arm":
        return texts.like_an_arm(factor)
    if cause.kind == "friction":
        return texts.like_friction(factor)
    sensor = cause.sensor
    assert sensor is not None
    if cause.kind == "zero":
        return texts.like_a_zero(cause.change, sensor.si)
    is_position = cause.kind == "scale"
    unit = _unit_words(1 / factor if is_position else factor, sensor, is_position)
    if unit is not None:
        return unit
    if not is_position:
        return texts.like_a_compliance(factor, sensor.of)
    gear = getattr(sensor, "gear", 1.0)
    return texts.like_a_scale(factor, gear, is_capstan=sensor.si == "rad")


def _unit_words(scale: float, sensor: Sensor, is_position: bool) -> str | None:
    """Return what a drive's position or force looks like if its `scale` is that of a unit; None
    where it is of none.
    """
    si = sensor.si if is_position else _unit_of_force(sensor)
    for unit, words in UNIT_FACTORS.items():
        like = words.get(si, words.get(""))
        is_unit = unit > 0 and scale > 0 and abs(np.log(scale / unit)) < ALIKE
        if like is not None and is_unit:
            return like
    return None


def _unit_of_force(sensor: Sensor) -> str:
    """Return the SI unit of the force of a drive whose position a sensor measures."""
    return "N" if sensor.si == "m" else "N m"

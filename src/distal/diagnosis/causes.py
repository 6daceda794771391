"""Causes of an error at one drive, beside a known truth, and which of them explains most.

With the joints' true angles a drive's position needs no filter: s = σ (Σ_j c_j g_j(θ_j) + c_F F/K −
F_0/K) + a + f d − τ ds/dt, with g_j the position that joint j alone asks of the drive, F its
measured pull, F_0 that of pre-tension, K its tendons' stiffness, d the direction of motion. A rig
that is right has σ = c = 1, a = τ = 0. All of these are estimated together with the rig's own stds
as priors (ridge regression). A cause is a change that frees one of them from its prior; the
likeliest is that of the largest gain in ln p.
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
"""A change of so many of the rig's own stds contradicts the rig, even where a wide band holds the
truth.
"""

LEAST_GAIN = 2.0
"""A cause gains so much in −2 ln p where the truth contradicts, so that something is wrong (Kass
and Raftery, J. American Statistical Association 90, 1995: above 2 is positive evidence).
"""

SIGN_OF_FORCE = 10.0
"""A pull that rises with the angle goes with it as a gear does: its sign has to gain so many times
as much.
"""

ALIKE = 0.15
"""A factor as near to that of a unit, as logarithms, is that unit."""

MOST = 2
"""So many causes are named."""


ROUNDS = 8
"""So often priors and what is left are weighed anew."""


@dataclass(frozen=True, eq=False)
class Cause:
    """What would explain an error: a `change` of a `subject`, whose column has some `values`, and
    what it does.

    Args:
        std: how well the rig knows it, in the unit of its change.
        size: by how much it moves the angle [rad].
        gain: in −2 ln p, its own prior being Cauchy's.
        paths: of the rig's numbers that stand for it, where there are any.
        sensor: of the drive's position, where it is of one drive.
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
        """What the subject looks like."""
        return _words(self)

    @property
    def units(self) -> list[float]:
        """Factors of units that readings of a force may be in, and of a wrong sign."""
        assert self.sensor is not None
        unit = _unit_of_force(self.sensor)
        return [factor for factor, words in UNIT_FACTORS.items() if unit in words or "" in words]

    @property
    def unlikely(self) -> float:
        """How far it is from what the rig says, in stds: of a factor, as logarithms."""
        if self.kind == "swap":
            return BEYOND
        if self.kind in ("zero", "delay"):
            return abs(self.change) / self.std
        factor = 1.0 + self.change
        turned = BEYOND if factor < 0.0 else 0.0
        return float(np.hypot(np.log(max(abs(factor), 1e-6)) / self.std, turned))

    @property
    def undone(self) -> list[ModelChange]:
        """The changes of readings, or of the rig's numbers, of which each takes it off."""
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
        """Whether a scale or an arm is farther from what the rig says than its `std`, as a share,
        allows.

        Forces have friction in them, and zeros are what forces and stiffness leave: of these a
        right rig's differ too.
        """
        if self.kind == "swap":
            return True
        if self.kind not in ("scale", "arm"):
            return False
        return self.change <= -1 or bool(abs(np.log1p(self.change)) > BEYOND * self.std)


class _Fit(NamedTuple):
    """Changes by ridge regression with priors, what they leave, and −2 ln p with the priors."""

    changes: Mapping[Cause, float]
    left: Floats
    cost: float


@dataclass(frozen=True, eq=False)
class DriveResidual:
    """What the position of a drive leaves beside the truth, and what may explain it.

    Args:
        residual: of its position at the samples that are known, (k,) [m, rad].
        causes_tried: each with its column and its prior std.
        nuisances: columns of what is always unknown, with their prior stds.
        count: of independent samples.
        lever: position for an angle of the joint that it turns most [m/rad, 1].
    """

    sensor: Sensor
    residual: Floats
    causes_tried: tuple[Cause, ...]
    nuisances: tuple[tuple[Floats, float], ...]
    count: float
    lever: float

    def fit(self, free: Sequence[Cause] = ()) -> _Fit:
        """Return what all changes become with their priors, some of them free of theirs.

        A delay is no error of the rig that is always there: it is in where it is free.
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
            # a freed one has Cauchy's prior: of two that explain the same the one nearer to what
            # the rig says is likelier
            cost += 2.0 * float(np.log1p((found[each] / max(each.std, 1e-12)) ** 2))
        return _Fit(found, left, cost)

    def causes(self) -> list[Cause]:
        """Return the cause that gains most, and one more where it gains beside it."""
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
        """Return every cause as if it were the only one."""
        return [self._named(each, self._sizes([each])[0]) for each in self.causes_tried]

    def _sizes(self, free: Sequence[Cause]) -> Floats:
        """Return the changes of causes by least squares, with a zero that is free and nothing else:
        priors would make them smaller.
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

        A delay often goes with the motion itself, and has to gain twice as much; a force of the
        wrong sign `SIGN_OF_FORCE` times, since friction in it goes against the stretch.
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
    """Return what a drive's position or force looks like that a unit's factor mends; None where no
    unit does.
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

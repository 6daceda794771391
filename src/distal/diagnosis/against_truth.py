"""What a known truth says of an estimate, and the likeliest causes where its band does not hold the
truth.

With the joints' true angles a drive's place needs no filter: s = σ (Σ_j c_j g_j(θ_j) + c_F F/K −
F_0/K) + a + f d − τ ds/dt, with g_j the place that joint j alone asks of the drive, F its measured
pull, F_0 that of pre-tension, K its tendons' stiffness, d the direction of motion. A rig that is
right has σ = c = 1, a = τ = 0. All of these are estimated together with the rig's own stds as
priors (ridge regression). A cause is a change that frees one of them from its prior, or exchanges
two columns; the likeliest is that of the largest gain in ln p (Bayesian information criterion).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.diagnosis import sentences
from distal.diagnosis.explanations import UNIT_FACTORS
from distal.diagnosis.finding import Finding
from distal.diagnosis.rerun import Change, Rerun
from distal.logs import Log, true_angles
from distal.model import Mechanism
from distal.results import Estimate
from distal.rig import Rig, Sensor, Tendon

LEAST_INSIDE = 0.85
"""Share of the samples of all joints with a truth that a band has to hold; below it the truth
contradicts.
"""

LEAST_OF_JOINT = 0.7
"""The same of one joint: its errors last, so one of three rigs drawn from their stds had a joint at
0.73 to 0.84.
"""

SHARE = 0.25
"""A cause explains something if it moves the angle by this share of the error."""

BEYOND = 3.0
"""A change of so many of the rig's own stds contradicts the rig, even where a wide band holds the
truth.
"""

NOISE = 0.3
"""An RMS error above this share of the band's half-width, which is 0.51 if all of the band is used,
has a cause.

Right numbers in the rig file gave up to 0.29, numbers wrong by a factor of 0.5 to 2 inside of the
band 0.28 to 0.75.
"""

MUCH = 0.5
"""A cause inside of the band is sure where the filter errs by less than this share without it."""

INDEPENDENT = 0.25
"""Residuals are correlated over so long [s]: friction lasts as long as a motion does."""

LEAST_GAIN, SURE_GAIN = 2.0, 20.0
"""A cause gains so much in −2 ln p where the truth contradicts, so that something is wrong; two
columns are exchanged where that gains more (Kass and Raftery, J. American Statistical Association
90, 1995: above 10 is very strong evidence).
"""

FRICTION = 0.3
"""Prior std of friction in a drive, as a share of its pull."""

COMPLIANCE = 0.1
"""No stiffness or force scale is taken as known better than this share."""

STAYS = 0.02
"""A drive turns back where it has moved by this share of its range the other way."""

LEAST = 0.03
"""No moment arm, gear or unit is taken as known better than this share."""

ALIKE = 0.15
"""A factor as near to that of a unit, as logarithms, is that unit."""

LOST = float(np.deg2rad(10.0))
"""A filter that errs by more [rad] is lost: what led it there may be smaller than its error."""

MOVES = float(np.deg2rad(1.0))
"""A joint that turns by less [rad] says nothing of its arms."""

MOST = 2
"""So many causes are named."""


@dataclass(frozen=True, eq=False)
class Cause:
    """What would explain an error: a `change` of a `subject`, whose column has some `values`, and
    what it does.

    Args:
        std: how well the rig knows it, in the unit of its change.
        size: by how much it moves the angle [rad].
        gain: in −2 ln p, its own prior being Cauchy's.
        words: what the subject looks like.
        paths: of the rig's numbers that stand for it, where there are any.
    """

    subject: str
    kind: str
    values: Floats
    std: float = 0.0
    change: float = 0.0
    size: float = 0.0
    gain: float = 0.0
    words: str = ""
    paths: tuple[str, ...] = ()

    @property
    def undone(self) -> list[Change]:
        """The changes of readings, or of the rig's numbers, of which each takes it off; none of a
        delay.
        """
        factor = 1.0 + self.change
        if self.kind == "zero":
            return [Change(added={self.subject: -self.change})]
        if self.kind in ("delay", "swap") or factor == 0.0:
            return []
        if self.kind == "arm":
            return [Change(numbers=dict.fromkeys(self.paths, factor))]
        if self.kind == "scale":
            return [Change(channels={self.subject: 1 / factor})]
        return [
            Change(channels={self.subject: factor}),
            Change(numbers=dict.fromkeys(self.paths, 1 / factor)),
        ]

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


def against_truth(
    result: Estimate, log: Log, rig: Rig, rerun: Callable[[], Rerun] | None = None
) -> list[Finding]:
    """Return what speaks against an estimate's band, or for an error inside of it, after or before
    its likeliest causes.

    Inside of the band a cause is named where the filter, run again without it by `rerun`, errs by
    half as much.
    """
    if result.truths is None:
        return []
    errors = np.abs(result.angles - result.truths)
    held, known = errors <= BAND * result.angle_stds, np.isfinite(errors)
    shares = held.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    shares[~known.any(axis=0)] = 1.0
    worst = int(np.argmin(shares))
    rms = np.sqrt(np.nansum(errors**2, axis=0) / np.maximum(known.sum(axis=0), 1))
    if held.sum() < LEAST_INSIDE * known.sum() or shares[worst] < LEAST_OF_JOINT:
        outside = sentences.outside_the_truth(
            result.joint_names[worst], float(rms[worst]), float(shares[worst])
        )
        return [*causes(log, rig, float(rms.max())), outside]
    beyond = causes(log, rig, float(rms.max()), beyond=True)
    widths = BAND * np.median(result.angle_stds, axis=0)
    most = int(np.argmax(rms / widths))
    if beyond or rms[most] <= NOISE * widths[most]:
        return beyond
    inside = sentences.errs_inside(result.joint_names[most], float(rms[most]), float(shares[most]))
    if rerun is None:
        return [inside]
    tried = _likeliest(log, rig, float(rms[most]))
    sure = _confirmed(tried, rerun(), most) if tried else []
    return [inside, *(replace(cause, kind="would explain") for cause in _named(sure))]


def _confirmed(tried: Sequence[Cause], rerun: Rerun, joint: int) -> list[Cause]:
    """Return the causes without which the filter errs by less than `MUCH` of what it does with
    them, at a joint.
    """
    truths = true_angles(rerun.log, [joint.name for joint in rerun.runner.rig.joints])
    assert truths is not None

    def error(means: Floats) -> float:
        return float(np.sqrt(np.nanmean((means[:, joint] - truths[:, joint]) ** 2)))

    before, found = error(rerun.base.means), list[Cause]()
    for cause in tried:
        known = set(cause.paths) <= set(rerun.runner.parameter_names)
        changes = [change for change in cause.undone if known or not change.numbers]
        if any(error(rerun(change).means) < MUCH * before for change in changes):
            found.append(cause)
    return found


def causes(log: Log, rig: Rig, error: float, *, beyond: bool = False) -> list[Finding]:
    """Return what would explain an `error` of the angle [rad], the likeliest first; nothing where
    no truth is known.

    Of all causes, or only of those `beyond` what the rig's own stds allow.
    """
    return _named([cause for cause in _likeliest(log, rig, error) if cause.beyond or not beyond])


def _named(found: Sequence[Cause]) -> list[Finding]:
    """Return the first causes in words; several drives with one cause, such as a gear written for
    all, are one line.
    """
    named: dict[str, list[str]] = {}
    for cause in found:
        named.setdefault(cause.words, []).append(cause.subject)
    return [
        sentences.looks(" and ".join(subjects), words)
        for words, subjects in [*named.items()][:MOST]
    ]


def _likeliest(log: Log, rig: Rig, error: float) -> list[Cause]:
    """Return what would explain an `error` of the angle [rad], the likeliest first."""
    angles, error = true_angles(log, [joint.name for joint in rig.joints]), min(error, LOST)
    if angles is None:
        return []
    known = [
        drive
        for drive in (_drive(log, rig, angles, sensor) for sensor in rig.sensors_of("position"))
        if drive is not None
    ]
    found = [cause for drive in known for cause in drive.causes()]
    found += _swaps(log, rig, angles, known)
    found.sort(key=lambda cause: -round(cause.gain))
    return [cause for cause in found if cause.size > SHARE * error]


class _Fit(NamedTuple):
    """Changes by ridge regression with priors, what they leave, and −2 ln p with the priors."""

    changes: Mapping[Cause, float]
    left: Floats
    cost: float


@dataclass(frozen=True, eq=False)
class _Drive:
    """What the place of a drive leaves beside the truth, and what may explain it.

    Args:
        residual: of its place at the samples that are known, (k,) [m, rad].
        causes_tried: each with its column and its prior std.
        nuisances: columns of what is always unknown, with their prior stds.
        count: of independent samples.
        lever: place for an angle of the joint that it turns most [m/rad, 1].
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
        matrix, residual = np.column_stack(columns), self.residual
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
        free, found = list[Cause](), list[Cause]()
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
        wrong sign four times, since friction in it goes against the stretch.
        """
        gain = before.cost - after.cost
        if cause.kind == "delay":
            return gain / 2.0
        if cause.kind in ("force", "stiffness") and after.changes[cause] < -1.0:
            return gain / 4.0
        return gain

    def _named(self, cause: Cause, change: float) -> Cause:
        size = abs(change) * float(np.sqrt(np.mean(cause.values**2))) / self.lever
        words = _words(cause.kind, float(change), self.sensor)
        return replace(cause, change=float(change), size=size, words=words)


ROUNDS = 8
"""So often priors and what is left are weighed anew."""


def _swaps(log: Log, rig: Rig, angles: Floats, drives: Sequence[_Drive]) -> list[Cause]:
    """Return the columns of a kind that explain more when they are exchanged."""
    before = {drive.sensor.name: drive.fit() for drive in drives}
    by_drive = {drive.sensor.of: drive.sensor for drive in drives}
    found = list[Cause]()
    for kind in ("position", "force"):
        read = [s for s in rig.sensors_of(kind) if s.of in by_drive and s.name in log.channels]
        for first, second in combinations(read, 2):
            places = [by_drive[first.of], by_drive[second.of]]
            exchanged = replace(log, channels={**log.channels, **_exchanged(log, first, second)})
            after = [_drive(exchanged, rig, angles, sensor) for sensor in places]
            fits = [drive.fit() for drive in after if drive is not None]
            if len(fits) < len(places):
                continue
            gain = sum(before[sensor.name].cost for sensor in places) - sum(f.cost for f in fits)
            if gain < SURE_GAIN:
                continue
            size = max(
                float(np.sqrt(np.mean((before[drive.sensor.name].left) ** 2))) / drive.lever
                for drive in drives
                if drive.sensor in places
            )
            subject = f"{first.name} and {second.name}"
            found.append(Cause(subject, "swap", np.zeros(0), size=size, gain=gain, words=SWAPPED))
    return found


SWAPPED = "swapped"


def _exchanged(log: Log, first: Sensor, second: Sensor) -> dict[str, Floats]:
    return {first.name: log.channels[second.name], second.name: log.channels[first.name]}


def _drive(log: Log, rig: Rig, angles: Floats, sensor: Sensor) -> _Drive | None:
    """Return what the place of one drive leaves, None where nothing can be told of it."""
    if sensor.name not in log.channels:
        return None
    mechanism, readings = Mechanism(rig), log.channels[sensor.name]
    drive = [drive.name for drive in rig.drives].index(sensor.of)
    asked, slopes, compliance, standing = _asked(mechanism, drive, angles)
    asked = np.where(slopes != 0.0, asked, 0.0)  # of another joint the truth may be missing
    turned = [
        int(j)
        for j in np.flatnonzero(slopes)
        if np.isfinite(angles[:, j]).any() and np.nanstd(angles[:, j]) > MOVES
    ]
    if not turned:
        return None
    force = next(
        (s for s in rig.sensors_of("force") if s.of == sensor.of and s.name in log.channels), None
    )
    pull = np.zeros(len(log)) if force is None else log.channels[force.name]
    stretch = np.zeros(len(log)) if force is None else (pull - standing) * compliance
    rate = np.gradient(np.where(np.isfinite(readings), readings, 0.0), log.time)
    expected = asked.sum(axis=1) + stretch
    pulled = {i: tendon for i, tendon in enumerate(rig.tendons) if tendon.drive == sensor.of}
    arms = [_arm_std([*pulled.values()], joint.name) for joint in rig.joints]
    tried = [Cause(sensor.name, "scale", expected, max(arms[j] for j in turned))]
    if len(turned) > 1:
        for j in turned:
            name = rig.joints[j].name
            paths = tuple(
                f"tendons.{i}.{path}"
                for i, tendon in pulled.items()
                for path in _radii(tendon, name)
            )
            tried.append(Cause(f"{sensor.of} at {name}", "arm", asked[:, j], arms[j], paths=paths))
    soft = float(np.hypot(COMPLIANCE, _stiffness_std([*pulled.values()])))
    if force is not None:
        paths = tuple(f"tendons.{i}.stiffness" for i in pulled)
        tried.append(Cause(force.name, "force", pull * compliance, soft, paths=paths))
        tried.append(Cause(force.name, "stiffness", stretch, soft, paths=paths))
    known = np.isfinite(np.column_stack([readings, rate, *(cause.values for cause in tried)])).all(
        axis=1
    )
    if known.sum() < 10 * len(tried) or np.ptp(readings[known]) == 0.0:
        return None
    interval = float(np.median(np.diff(log.time)))
    stands = _zero_std(sensor, [*pulled.values()], compliance, soft * standing * compliance)
    tried += [
        Cause(sensor.name, "delay", -rate, interval),
        Cause(sensor.name, "zero", 1.0 + 0.0 * rate, stands),
    ]
    span = float(np.ptp(readings[known]))
    way = _direction(readings[known], STAYS * span)
    friction = FRICTION * float(np.median(np.abs(pull[known]))) * compliance
    nuisances = [(way, max(friction, 1e-3 * span))]
    if force is not None:
        nuisances.append((way * pull[known] * compliance, FRICTION))
    return _Drive(
        sensor,
        (readings - expected)[known],
        tuple(replace(cause, values=cause.values[known]) for cause in tried),
        tuple(nuisances),
        max(float(known.sum()) * min(1.0, interval / INDEPENDENT), 2.0),
        max(abs(slopes[j]) for j in turned),
    )


def _direction(readings: Floats, half: float) -> Floats:
    """Return which way a drive last moved, −1 to 1, by a play of some half-width."""
    passed = np.empty_like(readings)
    held = readings[0]
    for k, reading in enumerate(readings.tolist()):
        held = min(max(held, reading - half), reading + half)
        passed[k] = held
    ways: Floats = (readings - passed) / half
    return ways


def _stiffness_std(pulled: Sequence[Tendon]) -> float:
    """Return how well the stiffness of a drive's tendons is known, as a share."""
    return max(
        (t.stiffness.total_std / t.stiffness.value for t in pulled if t.stiffness.value > 0.0),
        default=0.0,
    )


def _zero_std(sensor: Sensor, pulled: Sequence[Tendon], compliance: float, soft: float) -> float:
    """Return how well the zero of a drive's place is known [m, rad]: its sensor's, what pre-tension
    stretches, and what is `soft` of that.
    """
    bias = getattr(sensor, "bias", None)
    own = 0.0 if bias is None else bias.total_std
    tension = max((t.pretension.total_std for t in pulled), default=0.0) * abs(compliance)
    least = LEAST_ZERO[sensor.si]
    return float(np.sqrt(own**2 + tension**2 + soft**2 + least**2))


LEAST_ZERO = {"m": 1e-4, "rad": float(np.deg2rad(1.0))}
"""No zero of a slider or a motor is taken as known better than this [m, rad]."""


def _arm_std(pulled: Sequence[Tendon], joint: str) -> float:
    """Return how well the moment arm of a drive's tendons at a joint is known, as a share."""
    stds = [LEAST]
    for meeting in (
        meeting for tendon in pulled for meeting in tendon.meetings if joint in meeting.joints
    ):
        radius = getattr(meeting.shape, "radius", None)
        if radius is not None and radius.value:
            stds.append(radius.total_std / abs(radius.value))
    return max(stds)


def _radii(tendon: Tendon, joint: str) -> list[str]:
    """Return the paths, behind that of a tendon, of the radii at which it meets a joint."""
    return [
        f"{meeting.path}.radius"
        for meeting in tendon.meetings
        if joint in meeting.joints and hasattr(meeting.shape, "radius")
    ]


def _words(kind: str, change: float, sensor: Sensor) -> str:
    """Return what the subject of a kind of cause looks like."""
    factor = 1.0 + change
    if kind == "zero":
        return sentences.like_a_zero(change, sensor.si)
    if kind == "delay":
        return sentences.like_a_delay(change)
    if kind == "arm":
        return sentences.like_an_arm(factor)
    scale, si = (
        (1 / factor, sensor.si) if kind == "scale" else (factor, "N" if sensor.si == "m" else "N m")
    )
    for unit, words in UNIT_FACTORS.items():
        like = words.get(si, words.get(""))
        if like is not None and unit > 0 and scale > 0 and abs(np.log(scale / unit)) < ALIKE:
            return like
    if kind in ("force", "stiffness"):
        return sentences.like_a_compliance(factor, sensor.of)
    return sentences.like_a_scale(
        factor, getattr(sensor, "gear", 1.0), is_capstan=sensor.si == "rad"
    )


def _asked(mechanism: Mechanism, drive: int, angles: Floats) -> tuple[Floats, Floats, float, float]:
    """Return the place that each joint alone asks of a drive, (k, n_joints), its slopes at zero,
    1/K and F_0.
    """
    nj, n, body = mechanism.n_joints, mechanism.n_bodies, mechanism.n_joints + drive
    q, p = ca.SX.sym("q", n), mechanism.parameters
    stretch, levers = mechanism.stretch(drive, q), mechanism.length_jacobian(q)[:, body]
    pulled = [i for i, of in enumerate(mechanism.drive_of) if of == body]
    stiffness = sum((levers[i] ** 2 * p[f"tendons.{i}.stiffness"] for i in pulled), ca.SX(0))
    standing = sum((levers[i] * p[f"tendons.{i}.pretension"] for i in pulled), ca.SX(0))
    outputs = [-stretch, -ca.jacobian(stretch, q[:nj]), 1 / stiffness, standing]
    look = ca.Function("asked", [q, p.symbols], outputs)
    zero, slopes, compliance, pull = look(np.zeros(n), p.values)
    asked = np.zeros(angles.shape)
    for j in range(nj):
        at = np.zeros((n, len(angles)))
        at[j] = angles[:, j]
        asked[:, j] = np.array(look(at, p.values)[0]).ravel() - float(zero)
    return asked, np.array(slopes).ravel(), float(compliance), float(pull)

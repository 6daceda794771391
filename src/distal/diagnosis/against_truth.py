"""What a known truth says of an estimate, and the likeliest causes where its band does not hold the
truth.

With the joints' true angles a drive's place needs no filter: s = σ (Σ_j c_j g_j(θ_j) + c_F F/K −
F_0/K) + a − τ ds/dt, with g_j the place that joint j alone asks of the drive, F its measured pull,
F_0 that of pre-tension, K its tendons' stiffness. A rig that is right has σ = c = 1, a = τ = 0. The
cause is the change, or the two, that take most off the residual.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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
"""One more cause is taken where it leaves less than this share of what there is without it."""

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
        std: how well the rig knows it, as a share, of scales and arms.
        size: by how much it moves the angle [rad].
        words: what the subject looks like.
        paths: of the rig's numbers that stand for it, where there are any.
    """

    subject: str
    kind: str
    values: Floats
    std: float = 0.0
    change: float = 0.0
    size: float = 0.0
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
        if self.kind == "delay" or factor == 0.0:
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
    drives = [_of_drive(log, rig, angles, sensor, error) for sensor in rig.sensors_of("position")]
    drives.sort(key=lambda found: -max((cause.size for cause in found), default=0.0))
    return [cause for found in drives for cause in found if cause.size > SHARE * error]


def _of_drive(log: Log, rig: Rig, angles: Floats, sensor: Sensor, error: float) -> list[Cause]:
    """Return the cause that takes most off what the place of one drive leaves, or two that take off
    much more.
    """
    if sensor.name not in log.channels:
        return []
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
        return []
    force = next(
        (s for s in rig.sensors_of("force") if s.of == sensor.of and s.name in log.channels), None
    )
    stretch = (
        np.zeros(len(log)) if force is None else (log.channels[force.name] - standing) * compliance
    )
    rate = np.gradient(np.where(np.isfinite(readings), readings, 0.0), log.time)
    expected = asked.sum(axis=1) + stretch
    pulled = {i: tendon for i, tendon in enumerate(rig.tendons) if tendon.drive == sensor.of}
    arms = [_arm_std([*pulled.values()], joint.name) for joint in rig.joints]
    lever = max(abs(slopes[j]) for j in turned)
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
    if force is not None:
        paths = tuple(f"tendons.{i}.stiffness" for i in pulled)
        tried.append(Cause(force.name, "force", stretch + standing * compliance, paths=paths))
    tried += [Cause(sensor.name, "delay", -rate), Cause(sensor.name, "zero", np.ones(len(log)))]
    known = np.isfinite(np.column_stack([readings, *(cause.values for cause in tried)])).all(axis=1)
    if known.sum() < 10 * len(tried) or np.ptp(readings[known]) == 0.0:
        return []
    residual = (readings - expected)[known]
    columns = {cause: cause.values[known] for cause in tried}
    none, one, two = (
        min(_fits(columns, residual, count), key=lambda fit: fit.judged) for count in (0, 1, 2)
    )
    best = one if one.left < MUCH * none.left else none
    if two.left < MUCH * best.left and best.left > SHARE * error * lever:
        best = two
    found = list[Cause]()
    for cause, change in zip(best.causes, best.changes):
        size = abs(change) * float(np.sqrt(np.mean(columns[cause] ** 2))) / lever
        found.append(
            replace(cause, change=change, size=size, words=_words(cause.kind, change, sensor))
        )
    # what else is wrong shifts the zero too, which is therefore named last
    return sorted(found, key=lambda cause: (cause.kind == "zero", -cause.size))


class _Fit(NamedTuple):
    """Some causes, their changes by least squares, and the RMS of what these leave."""

    causes: tuple[Cause, ...]
    changes: list[float]
    left: float

    @property
    def judged(self) -> float:
        """What it leaves; twice that where a force or a delay explains it, which often go with the
        angle themselves.

        Four times that for a force of the wrong sign: friction in it goes against the stretch.
        """
        weights = (_weight(cause.kind, change) for cause, change in zip(self.causes, self.changes))
        return self.left * max(weights, default=1.0)


def _weight(kind: str, change: float) -> float:
    """Return by how much a cause has to explain more than others, because it explains what they
    do.
    """
    if kind == "force" and change < -1:
        return 4.0
    return 2.0 if kind in ("force", "delay") else 1.0


def _fits(columns: Mapping[Cause, Floats], residual: Floats, count: int) -> Iterator[_Fit]:
    """Yield the fit of each combination of so many causes to a residual, the last one, the zero,
    always with them.
    """
    *others, zero = columns
    for chosen in ((*each, zero) for each in combinations(others, count)):
        matrix = np.column_stack([columns[cause] for cause in chosen])
        scales = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        changes = np.linalg.lstsq(matrix / scales, residual, rcond=1e-9)[0] / scales
        yield _Fit(
            chosen, changes.tolist(), float(np.sqrt(np.mean((residual - matrix @ changes) ** 2)))
        )


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
    if kind == "force":
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

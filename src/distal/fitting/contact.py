"""`learn_contact`: the torque on the joint from outside, from logs in which it was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError, FitError
from distal.estimators import channels_of
from distal.estimators.affine import NORMAL, conformal_factor, random_effects, student
from distal.estimators.contact import design, homed
from distal.estimators.contact.terms import outside
from distal.fitting.affine import LeftOut
from distal.fitting.discrepancy_learning import row_of
from distal.fitting.groups import folds_of, groups_of
from distal.homing import held
from distal.logs import Log, read_log, shown, true_torques
from distal.rig import AffineJoint, Contact, Rig, load_rig

Floats = NDArray[np.float64]

SLIPS = (0.025, 0.05, 0.1)
"""Half-widths of the plays that are tried, in standard deviations of a drive's place."""

BETTER = 0.97
"""More terms are taken where their error on left-out logs is below this share of that of fewer terms."""

ENOUGH = 5
"""With fewer logs than this the band is widened."""

LEAST, LARGEST = 0.5, 30.0
"""Errors on left-out logs make the band between this much narrower and this much wider."""


@dataclass(frozen=True)
class Torques:
    """A log as the contact sees it.

    Args:
        source: its name.
        time: since its first sample [s], (k,).
        readings: of the channels, missing ones held, (k, m).
        torques: true ones [N m], NaN where not known, (k, n_joints).
        interval: between samples [s].
    """

    source: str
    time: Floats
    readings: Floats
    torques: Floats
    interval: float


@dataclass(frozen=True)
class ContactFit:
    """What `learn_contact` found.

    Args:
        rig: the description with `[contact]`.
        logs: names of the logs.
        homing: for how long the torque was read on each log left out [s], or None.
        left_out: one for each log, in N m; empty with fewer than two groups.
    """

    rig: Rig
    logs: tuple[str, ...]
    homing: float | None
    left_out: tuple[LeftOut, ...]

    @property
    def contact(self) -> Contact:
        """The map."""
        assert self.rig.contact is not None
        return self.rig.contact

    @property
    def text(self) -> str:
        """The outcome in one line."""
        if not self.left_out:
            return f"contact: the torque from outside, learned from {len(self.logs)} log(s)"
        rms = [1e3 * one.rms for one in self.left_out]
        inside = 100.0 * float(np.mean([one.inside for one in self.left_out]))
        return (
            f"contact: the torque from outside, learned from {len(self.logs)} logs; each left out once: mean RMS "
            f"{np.mean(rms):.2f} mN m, worst {max(rms):.2f} mN m, {inside:.0f} % inside the band"
        )


def learn_contact(
    logs: Sequence[Any],
    rig: Rig | str,
    homing: float | None = None,
    groups: Sequence[str] | None = None,
    scored: bool = True,
) -> ContactFit:
    """Learn the torque on the joints from outside from logs in which it was measured.

    τ = Σ b φ, each log's b drawn from one normal distribution (random effects, as for `affine`); the terms are chosen by
    the error on logs left out, and the band is sized so that 95 % of these errors are inside. The rig's joint needs an
    ``external_torque.std``: where none can occur there is nothing to learn.

    Args:
        logs: each a `Log`, a path or a frame; those without a torque are passed over.
        rig: the description, or a shipped rig's name, or a path.
        homing: learn for the use after a window of so long [s] in which the torque is read.
        groups: of each log with a torque, which are left out together; default each alone.
        scored: whether each log is left out once more, for a score that neither choice nor size has seen.

    Raises:
        FitError: no log has a torque, or the rig says that none can occur.
    """
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    read = [log if isinstance(log, Log) else read_log(log, rig) for log in logs]
    for joint in rig.joints:
        if joint.external_torque.std == 0.0:
            raise FitError(
                f"contact: the rig says that nothing touches '{joint.name}'; "
                f"give its external_torque a std (--set 'joints.{joint.name}.external_torque.std=\"0.05 N m\"')"
            )
    data = [one for one in (torques_of(log, rig) for log in read) if one is not None]
    if not data:
        raise FitError(
            "contact: no log has the torque on the joint; add a sensor with measures = 'torque' of it, and its column"
        )
    names = list(groups) if groups is not None else [str(i) for i in range(len(data))]
    if len(names) != len(data):
        raise FitError(f"contact: {len(data)} logs have a torque, groups of {len(names)} came")
    folds = folds_of(names)
    made = _sized(data, rig, folds, homing)
    scores: list[LeftOut] = []
    if scored and len(set(folds)) > 2:
        for fold in sorted(set(folds)):
            rest = [i for i, own in enumerate(folds) if own != fold]
            taught = _sized([data[i] for i in rest], rig, [folds[i] for i in rest], homing)
            scores += [_score(taught, one, homing) for one, own in zip(data, folds) if own == fold]
    described = rig.with_values({"contact": made.model_dump()})
    return ContactFit(described, tuple(one.source for one in data), homing, tuple(scores))


def contact_of(logs: Sequence[Log], rig: Rig, homing: float | None, units: str | None) -> ContactFit | None:
    """Return what logs that have the torque on the joint teach of it; None where none has, or none can occur.

    Args:
        logs: of a fit.
        rig: the description, as fitted.
        homing: length of the homing move [s], or None.
        units: see `distal.fit`.
    """
    touched = [log for log in logs if true_torques(log, [joint.name for joint in rig.joints]) is not None]
    if not touched or any(joint.external_torque.std == 0.0 for joint in rig.joints):
        return None
    groups = None
    if units is not None:
        unit = dict(zip((log.source for log in logs), groups_of([log.source for log in logs], units)))
        groups = [unit[log.source] for log in touched]
    return learn_contact(touched, rig, homing, groups)


def torques_of(log: Log, rig: Rig) -> Torques | None:
    """Return a log as the contact sees it; None where it has no torque.

    Args:
        log: the log.
        rig: the description.

    Raises:
        EstimationError: the log lacks a sensor.
    """
    torques = true_torques(log, [joint.name for joint in rig.joints])
    if torques is None or not np.isfinite(torques).any():
        return None
    columns = []
    for sensor in _sensors(rig):
        if sensor.name not in log.channels:
            raise EstimationError(f"{log.source}: the sensor '{sensor.name}' is not in the log")
        offset = sensor.bias.value if sensor.measures == "position" else 0.0
        columns.append(held(log.channels[sensor.name]) - offset)
    interval = float(np.median(np.diff(log.time))) if len(log) > 1 else 1.0
    return Torques(log.source, log.time - log.time[0], np.column_stack(columns), torques, interval)


def _sensors(rig: Rig) -> tuple[Any, ...]:
    channels = channels_of(rig, "contact")
    return (*channels.positions, *channels.tensions, *channels.forces)


def _choices(rig: Rig) -> list[tuple[tuple[str, ...], float]]:
    """Return the sets of terms that are tried, fewer terms first, with the half-width of their plays."""
    sensors = _sensors(rig)
    places = [s.name for s in sensors if s.measures == "position"]
    efforts = [s.name for s in sensors if s.measures != "position"]
    linear = ("1", *efforts)
    sets = [(("1",), SLIPS[0]), (linear, SLIPS[0])]
    for width in SLIPS:
        rubbing = tuple(f"slip({x})" for x in places)
        products = tuple(f"slip({x})*abs({e})" for x in places for e in efforts)
        along = tuple(t for x in places for t in (x, f"{x}*{x}", *(f"{x}*{e}" for e in efforts)))
        sets.append(((*linear, *rubbing, *products), width))
        sets.append(((*linear, *rubbing, *products, *along), width))
    return sets


def _taught(data: Sequence[Torques], rig: Rig, terms: tuple[str, ...], slip: float) -> Contact:
    """Return what some logs teach with a set of terms, its band not yet sized."""
    every = np.vstack([one.readings for one in data])
    centre, spread = every.mean(axis=0), every.std(axis=0)
    size, sensors = len(terms), _sensors(rig)
    zero = AffineJoint(joint="joint", coefficients=(0.0,) * size, covariance=((0.0,) * size,) * size, std=1.0)
    frame = Contact(
        terms=terms,
        channels=tuple(sensor.name for sensor in sensors),
        centre=row_of(centre),
        scale=row_of(np.where(spread > 1e-12, spread, 1.0)),
        low=row_of(every.min(axis=0)),
        high=row_of(every.max(axis=0)),
        slip=slip,
        correlation_time=data[0].interval,
        spread=tuple(float(np.sqrt(np.nanmean(column**2))) for column in np.vstack([o.torques for o in data]).T),
        logs=len(data),
        joints=tuple(zero.model_copy(update={"joint": joint.name}) for joint in rig.joints),
    )
    joints, times = [], []
    for j, joint in enumerate(frame.joints):
        parts = []
        for one in data:
            phi, torque = design(frame, one.readings), one.torques[:, j]
            step = max(1, len(torque) // 2500)
            there = np.isfinite(torque)
            rows = np.flatnonzero(there)[::step]
            if len(rows) > size:
                parts.append((phi[rows], torque[rows], one.interval * step))
        if not parts:
            raise FitError(f"contact: the torque on '{joint.joint}' is known in no log")
        found, time = random_effects(joint, range(size), parts)
        joints.append(found)
        times.append(time)
    return frame.model_copy(update={"joints": tuple(joints), "correlation_time": max(times)})


Errors = list[tuple[Floats, Floats, Floats]]
"""Of each joint: errors [N m], variances, and what of them is not scaled (nothing)."""


def _errors(made: Contact, out: Torques, homing: float | None) -> Errors:
    """Return errors and variances of a map on a log that it has not seen."""
    late = np.ones(len(out.time), dtype=bool)
    if homing is not None:
        late = out.time >= homing
        made = homed(made, out.readings, out.torques, ~late, out.interval)
    phi, far, errors = design(made, out.readings), outside(made, out.readings), []
    for j, joint in enumerate(made.joints):
        leverage = np.sum(phi @ np.asarray(joint.covariance) * phi, axis=1)
        variance = made.band**2 * (leverage + joint.std**2) + far**2 * (joint.std**2 + made.spread[j] ** 2)
        error = phi @ np.asarray(joint.coefficients) - out.torques[:, j]
        there = late & np.isfinite(error)
        errors.append((error[there], variance[there], np.zeros(int(there.sum()))))
    return errors


def _left_out(
    data: Sequence[Torques], rig: Rig, folds: Sequence[int], homing: float | None, terms: tuple[str, ...], slip: float
) -> list[Errors]:
    found = []
    for fold in sorted(set(folds)):
        made = _taught([one for one, own in zip(data, folds) if own != fold], rig, terms, slip)
        found += [_errors(made, one, homing) for one, own in zip(data, folds) if own == fold]
    return found


def _sized(data: Sequence[Torques], rig: Rig, folds: Sequence[int], homing: float | None) -> Contact:
    """Return what logs teach, its terms chosen and its band sized by the errors of logs left out."""
    count = len(set(folds))
    if count < 2:
        return _taught(data, rig, *_choices(rig)[1])
    best, least, errors = _choices(rig)[0], float("inf"), list[Errors]()
    for terms, slip in _choices(rig):
        if len(terms) * 20 > min(len(one.time) for one in data):
            continue
        parts = _left_out(data, rig, folds, homing, terms, slip)
        rms = float(np.mean([np.sqrt(np.mean(error**2)) for logs in parts for error, _, _ in logs if len(error)]))
        if rms < BETTER * least or (len(terms) == len(best[0]) and rms < least):
            best, least, errors = (terms, slip), rms, parts
    # what scatters between few logs is known as Student's distribution says; a factor of its own, so that the spread
    # between logs stays what a homing move is weighed against
    wider = 1.0 if len(data) >= ENOUGH else student(len(data) - 1)
    band = max(conformal_factor(list(each), LEAST, LARGEST) for each in zip(*errors)) * wider
    return _taught(data, rig, *best).model_copy(update={"band": band})


def _score(made: Contact, out: Torques, homing: float | None) -> LeftOut:
    parts = _errors(made, out, homing)
    error = np.concatenate([part[0] for part in parts])
    std = np.sqrt(np.concatenate([part[1] for part in parts]))
    inside = float(np.mean(np.abs(error) <= NORMAL * std))
    return LeftOut(shown(out.source), float(np.sqrt(np.mean(error**2))), inside, float(NORMAL * std.mean()))

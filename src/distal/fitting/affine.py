"""`learn_affine`: the obvious estimator's map from logs whose angle is known, and how far it errs on logs left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import FitError
from distal.estimators.affine import (
    NORMAL,
    Readings,
    corrected,
    dead_bands,
    design,
    learned,
    noise_of,
    outside,
    predicted,
    readings_of,
    sized,
    student,
)
from distal.fitting.fitted_file import fitted_text, plain
from distal.homing import check_homing
from distal.logs import Log, read_log, shown, true_angles, write_whole
from distal.rig import Affine, Rig, load_rig

Floats = NDArray[np.float64]

ENOUGH = 5
"""With fewer logs than this, what changes from log to log is hardly known, and the band is widened for that."""

FOR_SIZE = 3
"""So many logs are needed to size the band by leaving one out."""

BETTER = 0.95
"""Directions are used where they bring the RMS error on left-out logs below this share of that without them."""

LEAST = 0.5
"""Errors on left-out logs make the spread between logs at most this much smaller."""


@dataclass(frozen=True)
class LeftOut:
    """How a map did on a log that it had not seen.

    Args:
        log: its name.
        rms: error [rad]; after the homing move where there is one.
        inside: share of samples inside the 95 % band.
        half: mean half-width of that band [rad].
    """

    log: str
    rms: float
    inside: float
    half: float


@dataclass(frozen=True)
class AffineFit:
    """What `learn_affine` found.

    Args:
        rig: the description with `[affine]`.
        start: the description as it came.
        logs: names of the logs.
        homing: for how long a reference was used on the logs left out [s], or None.
        left_out: one for each log; empty with fewer than three.
        notes: plain sentences on how few logs there are, what was dropped, and whether directions are used.
    """

    rig: Rig
    start: Rig
    logs: tuple[str, ...]
    homing: float | None
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]

    @property
    def affine(self) -> Affine:
        """The map."""
        assert self.rig.affine is not None
        return self.rig.affine

    @property
    def text(self) -> str:
        """The outcome in one line."""
        logs = f"{len(self.logs)} log{'s' if len(self.logs) != 1 else ''}"
        if not self.left_out:
            return f"affine: learned from {logs}"
        rms = [np.rad2deg(one.rms) for one in self.left_out]
        inside = 100.0 * float(np.mean([one.inside for one in self.left_out]))
        half = np.rad2deg(np.mean([one.half for one in self.left_out]))
        use = f" after a homing move of {self.homing:g} s" if self.homing is not None else ""
        return (
            f"affine: learned from {logs}; each left out once{use}: mean RMS {np.mean(rms):.3f}°, worst {max(rms):.3f}°, "
            f"{inside:.0f} % inside the band of ±{half:.2f}°"
        )

    def save(self, path: str | Path, text: str | None = None) -> None:
        """Write the rig file with `[affine]`; what stood there survives a failure.

        Args:
            path: where.
            text: TOML of the rig that the map is put into, so that its comments stay; default it is written anew.

        Raises:
            OutputError: it cannot be written.
        """
        write_whole(path, fitted_text(self.rig, self.start, {"affine": affine_table(self.affine)}, "", text))


def affine_table(affine: Affine) -> dict[str, Any]:
    """Return a map as a table of a rig file.

    Args:
        affine: the map.
    """
    table: dict[str, Any] = plain(affine.model_dump())
    return table


def learn_affine(
    logs: Sequence[Any] | Log | str | Path, rig: Rig | str | Path, homing: float | None = None, truth: str | None = None
) -> AffineFit:
    """Learn the map of the estimator `affine` from logs whose angle is known.

    Each log's coefficients are taken as drawn from one normal distribution (random effects; see
    `distal.estimators.affine.learned`). With three logs or more each is left out once: directions of motion are used
    where they help there, and the spread between logs is sized so that 95 % of those errors are in the band.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`); those without a truth are passed over.
        rig: the description, or a shipped rig's name, or a path.
        homing: judge directions and report errors as used after a homing move of so long [s].
        truth: where logs are read: the true angle's column.

    Raises:
        FitError: no log has a truth.
        EstimationError: the rig's sensors do not suffice, or a log lacks one.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    given = [logs] if isinstance(logs, (Log, str, Path)) else list(logs)
    read = [log if isinstance(log, Log) else read_log(log, rig, truth) for log in given]
    joints = [joint.name for joint in rig.joints]
    known = [log for log in read if true_angles(log, joints) is not None]
    if not known:
        raise FitError(f"affine: none of the {len(read)} logs has the joint's angle; give --truth, or log a reference")
    if homing is not None:
        for log in known:
            check_homing(homing, log, joints)
    bands = dead_bands(rig)
    readings = [readings_of(log, rig, bands) for log in known]
    readings = [one.part(np.asarray(np.isfinite(one.angles).any(axis=1))) for one in readings]
    notes: list[str] = []
    if len(readings) < ENOUGH:
        count = f"{len(readings)} log" + ("s" if len(readings) > 1 else "")
        notes.append(f"affine: {count} with a known angle: {_FEW[min(len(readings), 3)]}; {ENOUGH} or more are needed")
    directions, left_out = False, list[list[Readings]]()
    if len(readings) >= FOR_SIZE:
        left_out = [[one for one in readings if one is not out] for out in readings]
        straight = _rms(readings, left_out, rig, bands, False, homing)
        turning = _rms(readings, left_out, rig, bands, True, homing)
        directions = turning < BETTER * straight
        notes.append(
            f"affine: directions of motion are {'used' if directions else 'not used'}: on left-out logs the RMS error is "
            f"{np.rad2deg(turning):.3f}° with them, {np.rad2deg(straight):.3f}° without"
        )
    affine = learned(readings, rig, bands, directions)
    notes += [f"affine: not used, {text}" for text in affine.dropped]
    smallest = LEAST if len(readings) >= ENOUGH else student(len(readings) - 1)
    scores: list[LeftOut] = []
    if left_out:
        maps = [learned(rest, rig, bands, directions) for rest in left_out]
        errors = [[_errors(one, out, rig, j) for one, out in zip(maps, readings)] for j in range(len(joints))]
        affine = sized(affine, errors, smallest)
        for i, out in enumerate(readings):
            # the size comes from the other logs' errors, so that no log judges itself
            others = [[part for k, part in enumerate(parts) if k != i] for parts in errors]
            scores.append(_score(sized(maps[i], others, smallest), out, rig, homing))
    elif len(readings) > 1:
        affine = sized(affine, [[] for _ in joints], smallest)
    described = rig.with_values({"affine": affine.model_dump()})
    names = tuple(log.source for log in known)
    return AffineFit(described, rig, names, homing, tuple(scores), tuple(notes))


_FEW = {
    1: "what changes from log to log is not in its band",
    2: "how much changes from log to log is a guess, and its band is wide",
    3: "how much changes from log to log is hardly known, and its band is widened",
}


def _used(affine: Affine, out: Readings, rig: Rig, homing: float | None) -> tuple[Affine, Readings]:
    """Return the map as it is used on a log, and the part of the log where errors count."""
    if homing is None:
        return affine, out
    window = out.part(out.time < homing)
    return (corrected(affine, window, rig)[0] if len(window.time) > 1 else affine), out.part(out.time >= homing)


def _rms(
    readings: Sequence[Readings],
    left_out: Sequence[Sequence[Readings]],
    rig: Rig,
    bands: Sequence[float],
    directions: bool,
    homing: float | None,
) -> float:
    squares = []
    for out, rest in zip(readings, left_out):
        affine, after = _used(learned(rest, rig, bands, directions), out, rig, homing)
        columns = design(affine, after)
        for j, joint in enumerate(affine.joints):
            squares.append(float(np.nanmean((columns @ np.asarray(joint.coefficients) - after.angles[:, j]) ** 2)))
    return float(np.sqrt(np.mean(squares)))


def _errors(affine: Affine, out: Readings, rig: Rig, joint: int) -> tuple[Floats, Floats, Floats]:
    """Return errors on a left-out log [rad], their variance from the coefficients, and the rest of it."""
    own, columns = affine.joints[joint], design(affine, out)
    errors = columns @ np.asarray(own.coefficients) - out.angles[:, joint]
    there = np.isfinite(errors)
    leverage = np.sum(columns @ np.asarray(own.covariance) * columns, axis=1)
    rest = own.std**2 * (1.0 + outside(affine, out.values, noise_of(rig)) ** 2)
    return errors[there], leverage[there], rest[there]


def _score(affine: Affine, out: Readings, rig: Rig, homing: float | None) -> LeftOut:
    used, after = _used(affine, out, rig, homing)
    errors, stds = [], []
    for j in range(len(affine.joints)):
        angles, spread = predicted(used, after, noise_of(rig), j)
        there = np.isfinite(after.angles[:, j])
        errors.append((angles - after.angles[:, j])[there])
        stds.append(spread[there])
    error, std = np.concatenate(errors), np.concatenate(stds)
    inside = float(np.mean(np.abs(error) <= NORMAL * std))
    return LeftOut(shown(out.source), float(np.sqrt(np.mean(error**2))), inside, float(NORMAL * std.mean()))

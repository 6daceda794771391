"""`learn_discrepancy`: what the model leaves of the angle on logs with truth, and how far it errs on logs left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalError, FitError
from distal.estimators import AdaptiveFilter
from distal.estimators.affine import NORMAL
from distal.estimators.discrepancy import Samples
from distal.fitting.affine import LeftOut
from distal.fitting.discrepancy_learning import (
    ENOUGH,
    Errors,
    channels_of_rig,
    errors_of,
    factor_of,
    left_out_errors,
    scaled,
    sized,
)
from distal.fitting.discrepancy_terms import NO_CORRECTION, Choice, choices
from distal.fitting.groups import folds_of
from distal.homing import Window, check_homing, numbers_homed, plain_samples, with_references
from distal.logs import Log, read_log, shown, true_angles
from distal.rig import Discrepancy, Rig, load_rig
from distal.run import first_values, samples_of
from distal.sensors import variance

Floats = NDArray[np.float64]

BETTER = 0.85
"""A set of more terms is taken where its error on left-out logs is below this share of that of fewer terms."""

HELD = 0.8
"""A filter whose band holds this share of a single log needs no correction that only this log has taught."""

SETTLING = 0.5
"""Without homing a filter finds the joint within so long [s]; errors count after that."""


@dataclass(frozen=True)
class DiscrepancyFit:
    """What `learn_discrepancy` found.

    Args:
        rig: the description with `[discrepancy]`.
        start: the description as it came.
        logs: names of the logs.
        homing: for how long a reference was used on every log [s], or None.
        left_out: one for each log; empty with fewer than two.
        notes: plain sentences on how few logs there are and what was chosen.
    """

    rig: Rig
    start: Rig
    logs: tuple[str, ...]
    homing: float | None
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]

    @property
    def discrepancy(self) -> Discrepancy:
        """What was learned."""
        assert self.rig.discrepancy is not None
        return self.rig.discrepancy

    @property
    def text(self) -> str:
        """The outcome in one line."""
        logs = f"{len(self.logs)} log{'s' if len(self.logs) != 1 else ''}"
        if not self.left_out:
            return f"discrepancy: learned from {logs}"
        rms = [np.rad2deg(one.rms) for one in self.left_out]
        inside = 100.0 * float(np.mean([one.inside for one in self.left_out]))
        half = np.rad2deg(np.mean([one.half for one in self.left_out]))
        return (
            f"discrepancy: learned from {logs}; each left out once: mean RMS {np.mean(rms):.3f}°, worst {max(rms):.3f}°, "
            f"{inside:.0f} % inside the band of ±{half:.2f}°"
        )


def learn_discrepancy(
    logs: Sequence[Any] | Log | str | Path,
    rig: Rig | str | Path,
    homing: float | None = None,
    truth: str | None = None,
    groups: Sequence[str] | None = None,
    compiled: bool = True,
) -> DiscrepancyFit:
    """Learn what `adaptive` errs by from logs whose angle is known, and size its band by logs left out.

    Each log's coefficients are taken as drawn from one normal distribution, as for `affine`. Which terms there are is
    chosen by the error on left-out logs, and the band is sized so that 95 % of those errors are inside. The scores come
    from an outer round of leaving out, whose logs neither choice nor size has seen.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`); those without a truth are passed over.
        rig: the description, or a shipped rig's name, or a path.
        homing: learn for the use after a homing move of so long [s].
        truth: where logs are read: the true angle's column.
        groups: of each log with a truth, which are left out together (one instrument, one pose); default each alone.
        compiled: compile kernels where possible.

    Raises:
        FitError: no log has a truth, or the filter cannot run on any.
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
        raise FitError(
            f"discrepancy: none of the {len(read)} logs has the joint's angle; give --truth, or log a reference"
        )
    bare = rig if rig.discrepancy is None else rig.model_copy(update={"discrepancy": None})
    data, refused = filtered(known, bare, homing, compiled)
    if not data:
        raise FitError(f"discrepancy: adaptive cannot run on any of the logs: {refused[0]}")
    return learned_from(data, rig, homing, groups, tuple(refused))


def learned_from(
    data: Sequence[Samples],
    rig: Rig,
    homing: float | None,
    groups: Sequence[str] | None = None,
    notes: Sequence[str] = (),
    scored: bool = True,
) -> DiscrepancyFit:
    """Return what `learn_discrepancy` finds in logs that the filter has seen.

    Args:
        data: of the logs.
        rig: the description.
        homing: length of the homing move [s], or None.
        groups: which logs are left out together; default each alone.
        notes: said before those of this function.
        scored: whether each log is left out once more, for a score that neither choice nor size has seen.
    """
    said = list(notes)
    folds = folds_of(list(groups) if groups is not None else [one.source for one in data])
    chosen = _chosen(data, rig, folds, homing)
    made = sized(data, rig, folds, homing, chosen)
    said.append(f"discrepancy: {chosen.name}")
    if len(set(folds)) < ENOUGH:
        count = len(set(folds))
        said.append(
            f"discrepancy: {count} log{'s' if count > 1 else ''} or groups of logs with a known angle: how much changes "
            f"from log to log is hardly known, and the band is widened; {ENOUGH} or more are needed"
        )
    scores: list[LeftOut] = []
    if scored and len(set(folds)) > 1:
        for fold in sorted(set(folds)):
            rest = [i for i, own in enumerate(folds) if own != fold]
            some, own = [data[i] for i in rest], [folds[i] for i in rest]
            taught = sized(some, rig, own, homing, _chosen(some, rig, own, homing))
            scores += [_score(taught, data[i], homing) for i in range(len(data)) if folds[i] == fold]
    described = rig.with_values({"discrepancy": made.model_dump()})
    sources = tuple(one.source for one in data)
    return DiscrepancyFit(described, rig, sources, homing, tuple(scores), tuple(said))


def filtered(logs: Sequence[Log], rig: Rig, homing: float | None, compiled: bool) -> tuple[list[Samples], list[str]]:
    """Return what the filter makes of logs, and why of some it makes nothing.

    Args:
        logs: with truth.
        rig: the description, without a discrepancy.
        homing: length of the homing move [s], or None.
        compiled: compile the kernel where possible.
    """
    joints, data, refused = [joint.name for joint in rig.joints], list[Samples](), list[str]()
    runner = None
    for log in logs:
        truths = true_angles(log, joints)
        assert truths is not None
        try:
            if runner is None:
                described, references = with_references(rig, log) if homing is not None else (rig, ())
                runner = AdaptiveFilter(described, compiled, references=references)
            m = len(runner.places)
            proximal = samples_of(log, runner.channels[:m], runner.name)
            reference = np.full((len(log), len(runner.channels) - m), np.nan)
            unaided = np.column_stack([proximal, reference])
            start = runner.initial(log.time[0], np.append(first_values(proximal), reference[0]))
            if homing is not None:
                early = log.time - log.time[0] < homing
                check_homing(homing, log, joints)
                aided = np.column_stack([proximal, np.where(early[:, None], truths[:, : reference.shape[1]], np.nan)])
                start = numbers_homed(Window.of(runner, start, log, aided, truths, homing))
            counted = truths
            if homing is None and log.time[-1] - log.time[0] > 4 * SETTLING:
                # where the joint begins is not known yet: that is no error of the model
                counted = np.where((log.time - log.time[0] < SETTLING)[:, None], np.nan, truths)
            one = plain_samples(runner, start, log, unaided, counted)
        except DistalError as problem:
            refused.append(f"discrepancy: {shown(log.source)} is left out: {problem}")
            continue
        if not np.isfinite(one.angles).all():
            refused.append(f"discrepancy: {shown(log.source)} is left out: adaptive left all bounds on it")
            continue
        data.append(replace(one, reference_std=0.0 if homing is not None else reference_std(rig, log)))
    return data, refused


def reference_std(rig: Rig, log: Log) -> float:
    """Return what the angle sensor errs by that a log's truth comes from [rad]; 0 where it comes from elsewhere.

    Args:
        rig: the description.
        log: with truth.
    """
    if not log.truth_kind.by_sensor:
        return 0.0
    return max((float(np.hypot(s.bias.filter_std, np.sqrt(variance(s)))) for s in rig.sensors_of("angle")), default=0.0)


def _chosen(data: Sequence[Samples], rig: Rig, folds: Sequence[int], homing: float | None) -> Choice:
    """Return the set of terms with the least error on left-out logs; of a single log, on its halves."""
    channels = channels_of_rig(rig)
    every = np.vstack([one.readings for one in data])
    moving = tuple(name for name, column in zip(channels, every.T) if np.ptp(column) > 0.0)
    forces = tuple(s.name for s in rig.sensors if s.measures in ("force", "tension") and s.name in moving)
    sets = choices(moving, forces, [joint.name for joint in rig.joints])
    if len(set(folds)) < 2:
        if _honest(data):
            return NO_CORRECTION  # one log does not tell what comes again, and the filter's band held it
        data, folds, homing = _halves(data), [0, 1] * len(data), None
    best, least = sets[0], float("inf")
    for choice in sets:
        if len(choice.terms) * 20 > min(len(one.time) for one in data):
            continue
        parts = left_out_errors(data, rig, folds, homing, choice)
        # of each log alone, so that one that is unlike the others does not decide
        rms = float(np.mean([np.sqrt(np.mean(error**2)) for logs in parts for error, _, _ in logs if len(error)]))
        if choice is NO_CORRECTION and rms < max(one.reference_std for one in data):
            return choice  # what is less than the reference's own error is not worth a correction
        if rms < BETTER * least:
            best, least = choice, rms
    return best


def _honest(data: Sequence[Samples]) -> bool:
    """Return whether the filter's own band holds what it is to hold on some logs, nearly."""
    errors = np.concatenate([(one.truths - one.angles).ravel() for one in data])
    stds = np.sqrt(np.concatenate([one.variances.ravel() for one in data]))
    there = np.isfinite(errors)
    return float(np.mean(np.abs(errors[there]) <= NORMAL * stds[there])) >= HELD


def _halves(data: Sequence[Samples]) -> list[Samples]:
    halves = []
    for one in data:
        first = np.arange(len(one.time)) < len(one.time) // 2
        halves += [one.part(first), one.part(~first)]
    return halves


def widened(found: DiscrepancyFit, errors: Sequence[Errors]) -> DiscrepancyFit:
    """Return a discrepancy whose band also holds errors on logs that the whole fit was left without.

    Args:
        found: as learned; its physics have seen all logs.
        errors: for each log left out, of each joint (errors [rad], variance of the correction, the filter's own).
    """
    if not errors:
        return found
    count = len(found.discrepancy.joints)
    factors = [max(1.0, factor_of([parts[j] for parts in errors])) for j in range(count)]
    made = scaled(found.discrepancy, factors)
    return replace(found, rig=found.rig.with_values({"discrepancy": made.model_dump()}))


def _score(made: Discrepancy, out: Samples, homing: float | None) -> LeftOut:
    parts = errors_of(made, out, homing)
    error = np.concatenate([part[0] for part in parts])
    std = np.sqrt(np.concatenate([part[1] + part[2] for part in parts]))
    inside = float(np.mean(np.abs(error) <= NORMAL * std))
    return LeftOut(shown(out.source), float(np.sqrt(np.mean(error**2))), inside, float(NORMAL * std.mean()))

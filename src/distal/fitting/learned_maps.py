"""`learn_affine`, `learn_discrepancy` and `learn_contact`: maps learned from logs with a reference,
and judged on held-out logs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from distal.confidence import BAND
from distal.errors import FitError
from distal.estimators import affine_of, affine_samples
from distal.fitting.fitted_file import MARK, fitted_text, plain_value
from distal.fitting.map_samples import (
    contact_of,
    discrepancy_of,
    filtered,
    has_torque,
    partly_homed,
    torques_of,
)
from distal.homing import check_homing
from distal.logs import Log, Source, read_log, shown, true_angles, write_whole
from distal.regression import Kind, Samples, Terms, errors_of, folds_of, learn_map, splits
from distal.regression.learn_map import ENOUGH_LOGS
from distal.rig import LearnedMap, Rig, as_rig
from distal.threads import one_blas_thread

FOR_SCORES = 3
"""Number of logs, or groups of logs, from which on each is held out once more, for scores on which
neither the choice of terms nor the width of the band depends. Source: judgement.
"""


@dataclass(frozen=True)
class LeftOut:
    """The score of a map on a held-out log, after the homing window where there is one.

    Args:
        log: name of the log.
        rms: RMS error, in the unit of what is mapped.
        inside: share of the samples inside the 95 % band.
        half: mean half-width of that band, in the same unit.
    """

    log: str
    rms: float
    inside: float
    half: float


@dataclass(frozen=True)
class MapFit:
    """A learned map of a rig, with its scores on held-out logs.

    Args:
        rig: the description with the map in it.
        start: the original description.
        table: name of the map's table in the rig file.
        logs: names of the logs.
        homing: length of the homing move on the held-out logs [s], or None.
        left_out: the score on each log; empty with fewer than three groups.
        notes: sentences on how few logs there are, and on what was chosen and dropped.
        terms: the terms that were chosen.
    """

    rig: Rig
    start: Rig
    table: str
    logs: tuple[str, ...]
    homing: float | None
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]
    terms: Terms

    @property
    def learned(self) -> LearnedMap:
        """The learned map."""
        learned = getattr(self.rig, self.table)
        assert isinstance(learned, LearnedMap)
        return learned

    @property
    def text(self) -> str:
        """The scores of the map in one line."""
        logs = f"{len(self.logs)} log{'s' if len(self.logs) != 1 else ''}"
        if not self.left_out:
            return f"{self.table}: learned from {logs}"
        factor, unit = (1e3, " mN m") if self.table == "contact" else (np.rad2deg(1.0), "°")
        rms = [factor * score.rms for score in self.left_out]
        inside = 100.0 * float(np.mean([score.inside for score in self.left_out]))
        half = factor * np.mean([score.half for score in self.left_out])
        use = f" after a homing move of {self.homing:g} s" if self.homing is not None else ""
        return (
            f"{self.table}: learned from {logs}; each left out once{use}: mean RMS "
            f"{np.mean(rms):.3f}{unit}, worst "
            f"{max(rms):.3f}{unit}, {inside:.0f} % inside the band of ±{half:.2f}{unit}"
        )

    def as_table(self) -> dict[str, object]:
        """Return the map as a table of a rig file."""
        return plain_value(self.learned.model_dump())

    def with_map(self, learned: LearnedMap) -> MapFit:
        """Return the same with another map in place of this one."""
        return replace(self, rig=self.rig.model_copy(update={self.table: learned}))

    def save(self, path: str | Path, text: str | None = None, provisional: str = "") -> None:
        """Write the rig file with the map; if that fails, the old file is kept.

        The map is written into `text`, the TOML of the rig, so that its comments stay; without it
        the file is written anew. The sentence `provisional`, if any, is written into the file and
        at its head.

        Raises:
            OutputError: the file cannot be written.
        """
        values: dict[str, object] = {self.table: self.as_table()}
        rig = self.rig
        head = ""
        if provisional:
            values["provisional"] = provisional
            rig = rig.model_copy(update={"provisional": provisional})
            head = f"{MARK}fit`: {provisional}\n\n"
        write_whole(path, fitted_text(rig, self.start, values, head, text))


@one_blas_thread()
def learn_affine(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig | str | Path,
    homing: float | None = None,
    truth: str | None = None,
    groups: Sequence[str] | None = None,
) -> MapFit:
    """Learn the map of the estimator `affine` from logs whose angle is known.

    Each log's coefficients are taken as drawn from one normal distribution (random effects; Laird
    and Ware, Biometrics 38, 1982). Directions of motion are used where they lower the error on
    held-out logs, whose errors also size the band.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`); those without a known angle are
            passed over.
        homing: length of the homing move after which the map will be used [s], or None.
        truth: column of the true angle, where logs are read from files.
        groups: for each log of known angle the group that is held out with it; default each log
            alone.

    Raises:
        FitError: no log has a known angle.
        EstimationError: the rig's sensors do not suffice, or a log lacks one.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig, with_truth = _with_truth(logs, rig, truth, "affine")
    if homing is not None:
        for log in with_truth:
            check_homing(homing, log, rig.joint_names)
    data = [affine_samples(log, rig) for log in with_truth]
    data = [samples.part(np.asarray(np.isfinite(samples.targets).any(axis=1))) for samples in data]
    return map_of(data, affine_of(rig), rig, homing, groups)


@one_blas_thread()
def learn_discrepancy(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig | str | Path,
    homing: float | None = None,
    truth: str | None = None,
    groups: Sequence[str] | None = None,
    compiled: bool = True,
) -> MapFit:
    """Learn a correction map of the angle errors of `adaptive` from logs whose angle is known, and
    size its band by held-out logs.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`); those without a known angle are
            passed over.
        homing: length of the homing move after which the map will be used [s], or None.
        truth: column of the true angle, where logs are read from files.
        groups: for each log of known angle the group (one instrument, one pose) that is held out
            with it; default each log alone.
        compiled: whether the filter is compiled; else it is interpreted.

    Raises:
        FitError: no log has a known angle, or the filter cannot run on any.
        EstimationError: the rig's sensors do not suffice, or a log lacks one.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig, with_truth = _with_truth(logs, rig, truth, "discrepancy")
    bare = rig.model_copy(update={"discrepancy": None})
    by_log, refused = filtered(with_truth, [bare] * len(with_truth), homing, compiled)
    data = list(by_log.values())
    if not data:
        raise FitError(f"discrepancy: adaptive cannot run on any of the logs: {refused[0]}")
    ran = [with_truth[i] for i in by_log]
    partly = partly_homed(ran, [bare] * len(ran), homing, compiled)
    return map_of(
        data, discrepancy_of(rig, data), rig, homing, groups, notes=refused, partly=partly
    )


@one_blas_thread()
def learn_contact(
    logs: Sequence[Log | Source],
    rig: Rig | str | Path,
    homing: float | None = None,
    groups: Sequence[str] | None = None,
    scored: bool = True,
) -> MapFit:
    """Learn a map of the external torque on the joints from logs in which that torque was measured.

    Each joint of the rig needs an ``external_torque.std`` above zero: where no external torque can
    occur there is nothing to learn.

    Args:
        logs: each a `Log`, a path or a frame; those without an external torque are passed over.
        homing: length of a window at the beginning in which the torque is read, and after which the
            map will be used [s], or None.
        groups: for each log with an external torque the group that is held out with it; default
            each log alone.
        scored: whether each log is held out once more, for a score on which neither the choice of
            terms nor the width of the band depends.

    Raises:
        FitError: no log has an external torque, the rig says that none can occur, or `groups` has
            another length.
        EstimationError: a log lacks a sensor.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = as_rig(rig)
    read = logs_read(logs, rig, None)
    for joint in rig.joints:
        if joint.external_torque.std == 0.0:
            raise FitError(
                f"contact: the rig says that nothing touches '{joint.name}'; "
                "give its external_torque a std (--set "
                f"'joints.{joint.name}.external_torque.std=\"0.05 N m\"')"
            )
    data = [torques_of(log, rig) for log in read if has_torque(log, rig)]
    if not data:
        raise FitError(
            "contact: no log has the torque on the joint; add a sensor with measures = 'torque' "
            "of it, and its column"
        )
    if groups is not None and len(groups) != len(data):
        raise FitError(f"contact: {len(data)} logs have a torque, groups of {len(groups)} came")
    return map_of(data, contact_of(rig), rig, homing, groups, scored=scored)


def map_of(
    data: Sequence[Samples],
    kind: Kind,
    rig: Rig,
    homing: float | None,
    groups: Sequence[str] | None = None,
    *,
    notes: Sequence[str] = (),
    scored: bool = True,
    partly: Mapping[int, Samples] | None = None,
) -> MapFit:
    """Return the map of a kind that logs teach, and its scores on held-out logs.

    Args:
        data: the samples of each log.
        kind: what is mapped, and the sets of terms to choose from.
        rig: the description that the map is put into.
        homing: length of the homing window [s], or None.
        groups: for each log the group that is held out with it; default each log alone.
        notes: sentences that stand before those of this function.
        scored: whether each log is held out once more, and everything learned anew, for a score.
        partly: some of the logs after a homing move of half their range, see `learn_map`.
    """
    folds = folds_of(list(groups) if groups is not None else [str(i) for i in range(len(data))])
    learned, chosen = learn_map(data, kind, folds, homing, partly)
    sentences = [*notes, f"{kind.name}: {chosen.name}"]
    count = len(set(folds))
    if count < ENOUGH_LOGS:
        sentences.append(
            f"{kind.name}: {count} log{'s' if count > 1 else ''} or groups of logs with a known "
            "truth: how much changes "
            f"from log to log is hardly known, and the band is widened; {ENOUGH_LOGS} or more are "
            "needed"
        )
    sentences += [
        f"{kind.name}: not used, {text}" for text in learned.dropped if kind.name == "affine"
    ]
    scores = list[LeftOut]()
    for out, remaining in splits(folds) if scored and count >= FOR_SCORES else ():
        half = {k: partly[i] for k, i in enumerate(remaining) if partly and i in partly}
        from_rest, _ = learn_map(
            [data[i] for i in remaining], kind, [folds[i] for i in remaining], homing, half
        )
        scores += [_score(from_rest, data[i], kind, homing) for i in out]
    described = rig.with_values({kind.name: learned.model_dump()})
    sources = tuple(samples.source for samples in data)
    return MapFit(
        described, rig, kind.name, sources, homing, tuple(scores), tuple(sentences), chosen
    )


def logs_read(
    logs: Sequence[Log | Source] | Log | str | Path, rig: Rig, truth: str | None
) -> list[Log]:
    """Return the logs, those read that are no `Log` yet; `truth` is the column of the true
    angle.
    """
    sources = [logs] if isinstance(logs, (Log, str, Path)) else logs
    return [log if isinstance(log, Log) else read_log(log, rig, truth) for log in sources]


def _with_truth(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig | str | Path,
    truth: str | None,
    name: str,
) -> tuple[Rig, list[Log]]:
    rig = as_rig(rig)
    read = logs_read(logs, rig, truth)
    with_truth = [log for log in read if true_angles(log, rig.joint_names) is not None]
    if not with_truth:
        raise FitError(
            f"{name}: none of the {len(read)} logs has the joint's angle; give --truth, or log a "
            "reference"
        )
    return rig, with_truth


def _score(learned: LearnedMap, out: Samples, kind: Kind, homing: float | None) -> LeftOut:
    parts = errors_of(learned, out, kind, homing)
    error = np.concatenate([part[0] for part in parts])
    std = np.sqrt(np.concatenate([part[1] + part[2] for part in parts]))
    inside = float(np.mean(np.abs(error) <= BAND * std))
    return LeftOut(
        shown(out.source), float(np.sqrt(np.mean(error**2))), inside, float(BAND * std.mean())
    )

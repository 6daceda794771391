"""Maps learned from logs with a reference: of the angle by readings alone, of what a filter's angle
lacks, and of the torque from outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distal.errors import FitError
from distal.estimators import channels_of, of_part, parts_of, samples_of_angles
from distal.fitting.fitted_file import MARK, write_fitted
from distal.fitting.map_samples import filtered, torques_of, with_reference_error
from distal.fitting.map_search import learned_map
from distal.homing import check_homing
from distal.logs import Log, Source, read_log, true_angles, true_torques
from distal.regression import Samples, folds_of
from distal.rig import LearnedMap, Rig, as_rig
from distal.threads import one_blas_thread


@dataclass(frozen=True)
class MapFit:
    """Learned maps of a rig, one for each independent part, with their scores on logs left out.

    Args:
        kind: ``readings``, ``filter`` or ``torque``, as in `LearnedMaps`.
        maps: the maps.
        start: the original description.
        notes: sentences on logs that were passed over.
    """

    kind: str
    maps: tuple[LearnedMap, ...]
    start: Rig
    notes: tuple[str, ...] = ()

    @property
    def rig(self) -> Rig:
        """The description with the maps in it."""
        return self.start.with_map(**{self.kind: self.maps})

    @property
    def rms(self) -> float:
        """Mean over the joints of the RMS error on logs left out, in the unit of what is mapped."""
        return float(np.mean([rms for learned in self.maps for rms in learned.rms]))

    @property
    def inside(self) -> float:
        """Mean share of these errors inside the band."""
        return float(np.mean([share for learned in self.maps for share in learned.inside]))

    @property
    def text(self) -> str:
        """The scores in one line."""
        logs = max(learned.logs for learned in self.maps)
        factor, unit = (1e3, " mN m") if self.kind == "torque" else (np.rad2deg(1.0), "°")
        what = "readings alone" if self.kind == "readings" else self.kind
        return (
            f"map of {what}, learned from {logs} log{'s' if logs != 1 else ''}: on logs left out "
            f"an RMS error of {factor * self.rms:.3f}{unit}, {100 * self.inside:.0f} % inside the "
            "band"
        )

    def save(self, path: str | Path, text: str | None = None, provisional: str = "") -> None:
        """Write the rig file with the maps; if that fails, the old file is kept.

        They are written into `text`, the TOML of the rig, so that its comments stay; without it the
        file is written anew. The sentence `provisional`, if any, is written into the file and at
        its head.

        Raises:
            OutputError: the file cannot be written.
        """
        values: dict[str, object] = {"provisional": provisional} if provisional else {}
        rig = self.rig.model_copy(update=values)
        head = f"{MARK}fit`: {provisional}\n\n" if provisional else ""
        write_fitted(path, rig, self.start, values, head, text)


@one_blas_thread()
def learn_map(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig | str | Path,
    kind: str = "filter",
    *,
    homing: float | None = None,
    truth: str | None = None,
    groups: Sequence[str] | None = None,
    compiled: bool = True,
) -> MapFit:
    """Learn a map of one kind from logs with a reference; see docs/explanation/map.md.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`); those without the reference are
            passed over.
        kind: ``readings``: of the angles, by readings alone; ``filter``: of what the angles of
            `adaptive` lack; ``torque``: of the torque from outside.
        homing: length of the homing move after which the map will be used [s], or None.
        truth: column of the true angle, where logs are read from files.
        groups: for each log with a reference the group (one instrument, one pose) that is held out
            with it; default each log alone.
        compiled: whether the filter is compiled; else it is interpreted.

    Raises:
        FitError: no log has the reference, or the filter cannot run on any.
        EstimationError: the rig's sensors do not suffice, or a log lacks one.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = as_rig(rig)
    read = logs_read(logs, rig, truth)
    joints = rig.joint_names
    true = true_torques if kind == "torque" else true_angles
    with_reference = [log for log in read if true(log, joints) is not None]
    if not with_reference:
        what = "torque from outside" if kind == "torque" else "joint's angle"
        raise FitError(
            f"map of {kind}: none of the {len(read)} logs has the {what}; give --truth, or log a "
            "reference"
        )
    if groups is not None and len(groups) != len(with_reference):
        raise FitError(
            f"map of {kind}: {len(with_reference)} logs have it, groups of {len(groups)} came"
        )
    folds = folds_of(
        list(groups) if groups is not None else [str(i) for i in range(len(with_reference))]
    )
    if homing is not None and kind != "torque":
        for log in with_reference:
            check_homing(homing, log, joints)
    if kind != "filter":
        of = torques_of if kind == "torque" else samples_of_angles
        return map_of([of(log, rig) for log in with_reference], rig, kind, folds, homing)
    bare = rig.bare()
    by_log, refused = filtered(with_reference, [bare] * len(with_reference), homing, compiled)
    if not by_log:
        raise FitError(f"adaptive cannot run on any of the logs: {refused[0]}")
    of_kind = map_of(list(by_log.values()), rig, kind, [folds[i] for i in by_log], homing)
    return MapFit(kind, of_kind.maps, rig, tuple(refused))


def map_of(
    data: Sequence[Samples], rig: Rig, kind: str, folds: Sequence[int], homing: float | None
) -> MapFit:
    """Return the maps of a kind that logs teach.

    Args:
        data: the samples of each log, of all sensors and joints.
        kind: as for `learn_map`.
        folds: the fold of each log.
        homing: length of the homing window [s], or None.

    Raises:
        FitError: the rig says that nothing touches a joint.
    """
    if kind == "torque":
        for joint in rig.joints:
            if joint.external_torque.std == 0.0:
                raise FitError(
                    f"torque: the rig says that nothing touches '{joint.name}'; give its "
                    "external_torque a std (--set "
                    f"'joints.{joint.name}.external_torque.std=\"0.05 N m\"')"
                )
    channels = channels_of(rig, "regression")
    names = [sensor.name for sensor in channels.proximal]
    maps = []
    for part in parts_of(rig, channels):
        samples = [of_part(log, rig, names, part["joints"], part["channels"]) for log in data]
        maps.append(learned_map(samples, part, folds, homing))
    return MapFit(kind, tuple(maps), rig)


def with_its_reference_error(of_kind: MapFit, logs: Sequence[Log]) -> MapFit:
    """Return maps with the error of the reference's zero in their band, see
    `with_reference_error`.
    """
    maps = tuple(with_reference_error(learned, of_kind.start, logs) for learned in of_kind.maps)
    return MapFit(of_kind.kind, maps, of_kind.start, of_kind.notes)


def logs_read(
    logs: Sequence[Log | Source] | Log | str | Path, rig: Rig, truth: str | None
) -> list[Log]:
    """Return the logs, those read that are no `Log` yet; `truth` is the column of the true
    angle.
    """
    sources = [logs] if isinstance(logs, (Log, str, Path)) else logs
    return [log if isinstance(log, Log) else read_log(log, rig, truth) for log in sources]

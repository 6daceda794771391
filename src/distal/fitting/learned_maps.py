"""Maps learned from logs with a reference: of the angle by readings alone, and of what a filter's
angle lacks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from distal.estimators import channels_of, of_part, samples_of_angles
from distal.fitting.map_samples import (
    reference_variances,
)
from distal.fitting.map_search import HeldOut, learned_map, scores_of
from distal.logs import Log, Source, read_log
from distal.regression import Samples
from distal.rig import LearnedMap, MapArrays, Rig

Part = dict[str, tuple[str, ...]]
"""The fields of a `LearnedMap` that say what it speaks of and reads."""


@dataclass(frozen=True)
class MapFit:
    """Learned maps of a rig, one for each independent part, with their scores on logs left out.

    Args:
        kind: ``readings`` or ``filter``, as in `LearnedMaps`.
        maps: the maps.
        start: the original description.
        errors: joint → its errors on each log by what the other logs tell.
    """

    kind: str
    maps: tuple[LearnedMap, ...]
    start: Rig
    errors: Mapping[str, Sequence[HeldOut]] = field(default_factory=dict)

    @property
    def parts(self) -> list[Part]:
        """What each map speaks of and reads."""
        return [
            {"joints": m.joints, "channels": m.channels, "positions": m.positions}
            for m in self.maps
        ]

    def held_out(self, log: int) -> list[HeldOut]:
        """Return the errors of each joint on a log, by its index."""
        return [self.errors[joint][log] for joint in self.start.joint_names]


def map_of(
    data: Sequence[Samples],
    rig: Rig,
    kind: str,
    parts: Sequence[Part],
    folds: Sequence[int],
    homing: float | None,
) -> MapFit:
    """Return the maps of a kind that logs teach.

    Args:
        data: the samples of each log, of all sensors and joints.
        kind: ``readings``: of the angles, by readings alone; ``filter``: of what the angles of
            `adaptive` lack.
        parts: what each map speaks of and reads.
        folds: the fold of each log.
        homing: length of the homing window [s], or None.
    """
    names = [sensor.name for sensor in channels_of(rig, "regression").proximal]
    maps = []
    errors = dict[str, list[HeldOut]]()
    for part in parts:
        samples = [of_part(log, rig, names, part["joints"], part["channels"]) for log in data]
        learned, held_out = learned_map(samples, part, folds, homing)
        maps.append(learned)
        errors.update(zip(part["joints"], held_out))
    return MapFit(kind, tuple(maps), rig, errors)


def with_its_reference_error(of_kind: MapFit, logs: Sequence[Log]) -> MapFit:
    """Return maps with the error of the reference's zero in their band: an encoder that is mounted
    0.2° off is so in all logs, so that no held-out log shows it.
    """
    variances = reference_variances(of_kind.start, logs)
    maps = []
    for learned in of_kind.maps:
        arrays = dict(learned.arrays.by_name)
        arrays["noise"] = arrays["noise"] + [variances.get(j, 0.0) for j in learned.joints]
        maps.append(learned.model_copy(update={"arrays": MapArrays(**arrays)}))
    errors = {
        joint: [
            replace(log, variances=log.variances + variances.get(joint, 0.0)) for log in of_logs
        ]
        for joint, of_logs in of_kind.errors.items()
    }
    return replace(of_kind, maps=tuple(maps), errors=errors)


def pooled(
    beside: MapFit, alone: MapFit, data: Mapping[int, Samples], logs: Sequence[Log]
) -> tuple[MapFit, MapFit]:
    """Return maps on readings alone with their shares of each angle, and the maps beside a filter
    with the errors of both together.

    The shares go by the inverse of the mean squared errors on logs left out (Bates and Granger,
    Operational Research Quarterly 20, 1969): that of readings alone is f²/(r² + f²), with their r²
    and f² of the filter with its map. Both have the random error of the reference, which draws the
    shares towards one half.

    Args:
        beside: the maps beside the filter.
        alone: the maps on readings alone.
        data: the filter's samples along the logs, by the index of the log.
        logs: of known angle.
    """
    errors = dict[str, list[HeldOut]]()
    shares = dict[str, float]()
    for joint in beside.start.joint_names:
        of_alone = [alone.errors[joint][i] for i in data]
        square, of_filter = (
            max(float(np.mean([np.mean(log.errors**2) for log in logs_left_out])), 1e-300)
            for logs_left_out in (of_alone, beside.errors[joint])
        )
        shares[joint] = of_filter / (square + of_filter)
        pairs = zip(beside.errors[joint], of_alone)
        errors[joint] = [_pooled_errors(*pair, 1 - shares[joint]) for pair in pairs]
    scored = [
        learned.model_copy(update=scores_of([errors[joint] for joint in learned.joints]))
        for learned in beside.maps
    ]
    joints = beside.start.joint_names
    first = next(iter(data))
    true = samples_of_angles(logs[first], beside.start).targets
    # what is taken for the encoder's own offset is off the targets of the filter's map
    offsets = np.nanmean(true - data[first].angles - data[first].targets, axis=0)
    zeros = dict(zip(joints, offsets.tolist()))
    return with_shares(alone, shares, zeros), replace(beside, maps=tuple(scored), errors=errors)


def with_shares(
    alone: MapFit, shares: Mapping[str, float], zeros: Mapping[str, float] | None = None
) -> MapFit:
    """Return maps on readings alone with their share of each angle.

    Args:
        alone: the maps.
        shares: joint → share [1].
        zeros: joint → angle at the filter's zero [rad], which is taken off; None: nothing is.
    """
    maps = []
    for learned in alone.maps:
        mean = learned.arrays["mean"].copy()
        mean[:, 0] -= [zeros[joint] if zeros else 0.0 for joint in learned.joints]
        arrays = MapArrays(**{**learned.arrays.by_name, "mean": mean})
        share = tuple(shares[joint] for joint in learned.joints)
        maps.append(learned.model_copy(update={"share": share, "arrays": arrays}))
    return replace(alone, maps=tuple(maps))


def _pooled_errors(beside: HeldOut, alone: HeldOut, share: float) -> HeldOut:
    """Return the errors of the pool of two maps, of which the first has a `share` [1], see
    `distal.regression.reported_map`.
    """
    time, at, of_alone = np.intersect1d(beside.time, alone.time, return_indices=True)
    weights = np.array([share, 1 - share])
    errors = np.array([beside.errors[at], alone.errors[of_alone]])
    variances = np.array([beside.variances[at], alone.variances[of_alone]])
    mean = weights @ errors
    return HeldOut(time, mean, weights @ (variances + errors**2) - mean**2)


def logs_read(
    logs: Sequence[Log | Source] | Log | str | Path, rig: Rig, truth: str | None
) -> list[Log]:
    """Return the logs, those read that are no `Log` yet; `truth` is the column of the true
    angle.
    """
    sources = [logs] if isinstance(logs, (Log, str, Path)) else logs
    return [log if isinstance(log, Log) else read_log(log, rig, truth) for log in sources]

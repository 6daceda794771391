"""`learn`: everything that logs teach of a rig. A fold of `leave_out` is this call with fewer logs, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distal.estimators import affine_of, affine_samples
from distal.fitting.checks import unknown_joints
from distal.fitting.curves import curves
from distal.fitting.fitted import assignments
from distal.fitting.groups import groups_of
from distal.fitting.map_samples import discrepancy_of, filtered, mean_rms
from distal.fitting.maps import MapFit, learn_contact, map_of
from distal.fitting.numbers import Numbers, numbers_of
from distal.fitting.options import Options
from distal.fitting.progress import Progress
from distal.fitting.reference_error import with_reference_error
from distal.logs import Log, true_angles, true_torques
from distal.regression import Kind, Samples
from distal.rig import Rig

Floats = NDArray[np.float64]

SURER = 0.85
"""Narrower stds are taken where the angle's error is below this share."""

TOLD_OR_HELD: tuple[float | None, ...] = (None, 0.0)
"""Stds that are tried after a fit: as the logs tell them, or none, so that no log teaches the numbers anew."""

IN_DOUBT: tuple[float | None, ...] = (1.0, 0.3, 0.1, 0.0)
"""Shares of the priors' stds that are tried, widest first, where a fit is in doubt; 0 holds the numbers."""


@dataclass(frozen=True)
class Learned:
    """All that logs teach of a rig.

    Args:
        rig: the description with all of it.
        numbers: the rig's numbers.
        prior_share: share of the priors' stds that the file keeps; None where the stds are as the logs tell.
        curves: path → value of the position sensors' systematic errors.
        maps: what was learned beside the numbers, by the name of its table: ``affine``, ``discrepancy``, ``contact``.
        doubts: plain sentences on what speaks against the fit.
    """

    rig: Rig
    numbers: Numbers
    prior_share: float | None
    curves: Mapping[str, object]
    maps: Mapping[str, MapFit]
    doubts: tuple[str, ...]


def learn(logs: Sequence[Log], rig: Rig, options: Options, progress: Progress | None = None) -> Learned:
    """Return all that logs teach of a rig: its numbers, their stds, and what the model leaves.

    Everything that is chosen with logs is chosen here, from the rig as it came on.

    Args:
        logs: as read and checked.
        rig: the description, whose values and stds are the priors.
        options: what is asked of the fit.
        progress: called with what is done.

    Raises:
        FitError: the logs cannot be fitted.
    """
    known = [log for log in logs if true_angles(log, _names(rig)) is not None]
    numbers = numbers_of(logs, rig, options, bool(known), progress)
    learned_curves = curves(numbers.problem, numbers.found.z) if options.curves else {}

    def written(prior_share: float | None) -> Rig:
        values = {**assignments(numbers.fitted, numbers.problem.filter.rig, prior_share), **learned_curves}
        return described(rig, values)

    doubts = list(numbers.doubts)
    unknown = unknown_joints(known, rig) if known else []
    if unknown:
        doubts.append(
            f"the angle of {', '.join(unknown)} is known in no log: numbers of the rig are fitted, but no straight line "
            "(affine) and no correction (discrepancy), which are of all joints"
        )
    unsure = numbers.found.interrupted or bool(doubts)
    shares = IN_DOUBT if unsure else TOLD_OR_HELD
    share, learned = shares[0], written(shares[0])
    maps = list[MapFit]()
    if known and not unknown:
        data, refused = filtered(known, learned, options.homing, False)
        for other in shares[1:] if data and not numbers.found.interrupted else ():
            surer = written(other)
            as_sure, _ = filtered(known, surer, options.homing, False)
            if len(as_sure) == len(data) and mean_rms(as_sure) < SURER * mean_rms(data):
                learned, data, share = surer, as_sure, other
        doubts += refused
        maps += _angle_maps(known, data, rig, learned, options)
    maps += _contact_map(logs, learned, options)
    whole = learned.with_values({one.table: one.learned.model_dump() for one in maps}) if maps else learned
    return Learned(whole, numbers, share, learned_curves, {one.table: one for one in maps}, tuple(doubts))


def _angle_maps(
    known: Sequence[Log], data: Sequence[Samples], rig: Rig, learned: Rig, options: Options
) -> list[MapFit]:
    """Return the map of `affine`, and of what the filter's angles lack, from logs with a truth."""
    straight = [affine_samples(log, learned) for log in known]
    straight = [one.part(np.asarray(np.isfinite(one.targets).any(axis=1))) for one in straight]
    kinds: list[tuple[Kind, Sequence[Samples]]] = [(affine_of(learned), straight)]
    if data:
        kinds.append((discrepancy_of(learned, data), data))
    maps = []
    for kind, samples in kinds:
        groups = _groups([one.source for one in samples], options)
        one = map_of(samples, kind, learned, options.homing, groups, scored=False)
        if options.homing is None:
            one = one.with_map(with_reference_error(one.learned, rig, known))
        maps.append(one)
    return maps


def _contact_map(logs: Sequence[Log], learned: Rig, options: Options) -> list[MapFit]:
    """Return the map of the torque from outside, where logs have it and the rig says that it can occur."""
    felt = [log for log in logs if true_torques(log, _names(learned)) is not None]
    if not felt or any(joint.external_torque.std == 0.0 for joint in learned.joints):
        return []
    groups = _groups([log.source for log in felt], options)
    return [learn_contact(felt, learned, options.homing, groups, scored=False)]


def _groups(sources: Sequence[str], options: Options) -> list[str]:
    """Return which logs are left out together: those of one unit, else each alone."""
    return [str(i) for i in range(len(sources))] if options.units is None else groups_of(sources, options.units, 1)


def described(rig: Rig, values: Mapping[str, object]) -> Rig:
    """Return a rig with what was fitted of its own numbers; a reference that only the fit had is left out.

    Args:
        rig: the description as it came.
        values: path → value.
    """
    own = {
        path: value
        for path, value in values.items()
        if not path.startswith("sensors.") or int(path.split(".")[1]) < len(rig.sensors)
    }
    return rig.with_values(own) if own else rig


def _names(rig: Rig) -> list[str]:
    return [joint.name for joint in rig.joints]

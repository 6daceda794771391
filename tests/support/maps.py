"""Maps of one kind alone, without the other steps of a fit."""

from __future__ import annotations

from collections.abc import Sequence

from distal import Log, Rig
from distal.estimators import samples_of_angles
from distal.fitting.learned_maps import filtered, map_of
from distal.logs import true_angles
from distal.machine_limits import one_blas_thread
from distal.regression import folds_of


@one_blas_thread()
def with_learned_map(
    logs: Sequence[Log], rig: Rig, kind: str = "filter", homing: float | None = None
) -> Rig:
    """Return a rig with the map of one kind that logs teach; those without a known angle do not.

    Args:
        logs: the logs, each held out alone.
        rig: the description.
        kind: ``readings``: of the angles, by readings alone; ``filter``: of what the angles of
            `adaptive` lack.
        homing: length of the homing move after which the map will be used [s], or None.
    """
    known = [log for log in logs if true_angles(log, rig.joint_names) is not None]
    folds = folds_of([str(i) for i in range(len(known))])
    data = dict(enumerate(samples_of_angles(log, rig) for log in known))
    if kind == "filter":
        data, _ = filtered(known, [rig.bare()] * len(known), homing, True)
    learned = map_of(list(data.values()), rig, kind, [folds[i] for i in data], homing)
    return rig.with_map(**{kind: learned.maps})

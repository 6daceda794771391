"""`learn`: from logs to angles, without a rig file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from distal.fitting.fit import fit
from distal.fitting.learned_maps import MapFit
from distal.fitting.progress import Progress
from distal.fitting.result import Fit
from distal.from_logs import rig_from_logs
from distal.logs import Source, read_log


def learn(
    logs: Sequence[Source],
    *,
    truth: Sequence[str] = (),
    drives: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
    lag: float | None = None,
    progress: Progress | None = None,
    early: Callable[[MapFit], None] | None = None,
) -> Fit:
    """Learn from logs alone how well the joints can be known from the motors: which columns are
    what, the structure of the rig, its parameters and its maps.

    `Fit.answer` says how well, `Fit.save` writes the rig file, and `estimate` takes `Fit.rig`.

    Args:
        logs: paths or frames with the same columns; three of 20 to 40 s with the joints' angles are
            enough.
        truth: columns of joints' reference angles, where names do not say so.
        drives: column of a drive's position → its unit, or empty.
        ignore: columns that are none of this.
        lag: by how much the true angles are later than the drives [s]; see `fit`.
        progress: called with what the fit is doing.
        early: called with the map on readings alone within seconds.

    Raises:
        LogError: a log cannot be read, or has no time.
        RigError: no drive or no joint can be found; says what would help.
        FitError: the logs cannot be fitted.
    """
    draft = rig_from_logs(logs, truth=truth, drives=drives, ignore=ignore)
    read = [read_log(source, draft.rig) for source in logs]
    result = fit(read, draft.rig, progress=progress, early=early, lag=lag, guessed=True)
    return replace(result, text=draft.text)

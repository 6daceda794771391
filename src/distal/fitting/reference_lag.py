"""How much later a reference is than the drives: the lag of a camera or an encoder, by the density
of the map on readings alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Floats
from distal.estimators import channels_of, samples_of_angles
from distal.fitting.map_search import Seen, Task, clearly_gains
from distal.logs import Log
from distal.regression import FEWEST_LOGS, Prior, Samples
from distal.rig import Rig, angle_names

EARLIEST, LATEST = -0.1, 0.2
"""Range of the lags that are looked for [s]. Source: judgement (cameras)."""

STEP = 0.02
"""Step of the first search [s], which goes on beside the best. Source: judgement."""

BRIDGED = 2.5
"""Gap of a reference that is interpolated, in its usual intervals [1]. Source: judgement."""


@dataclass(frozen=True)
class ReferenceLag:
    """The lag of a reference behind the drives [s], and the drift of its clock [s/s]; both are zero
    where they do not make it clearly more probable on logs held out.
    """

    lag: float = 0.0
    drift: float = 0.0

    @property
    def sentences(self) -> list[str]:
        """What a user should know of them."""
        if self.lag == 0.0:
            return []
        which = "later" if self.lag > 0.0 else "earlier"
        lines = [
            f"the reference is taken as {1e3 * abs(self.lag):.0f} ms {which} than the drives, and "
            "moved by that; a joint that follows its drives late looks the same (--reference-lag 0 "
            "leaves it as it is)"
        ]
        if self.drift != 0.0:
            lines.append(
                "the reference's clock drifts beside that of the drives; read both by one clock"
            )
        return lines

    def taken_off(self, logs: Sequence[Log], rig: Rig) -> list[Log]:
        """Return the logs with their true angles moved back in time by the lag."""
        if self.lag == 0.0:
            return list(logs)
        names = angle_names(rig.joint_names)
        return [
            replace(
                log,
                truth={
                    name: _moved(log.time, values, self.lag) if name in names else values
                    for name, values in log.truth.items()
                },
            )
            for log in logs
        ]


def reference_lag(logs: Sequence[Log], rig: Rig, folds: Sequence[int]) -> ReferenceLag:
    """Return the lag of the true angles of some logs, each of which is in a fold.

    The joints' angles at t + lag are mapped from what is read up to t, and the lag is that with the
    largest density of held-out logs. A joint that follows its drives late looks the same, so that
    the lag is an assumption.
    """
    if len(set(folds)) < FEWEST_LOGS:
        return ReferenceLag()
    samples = [samples_of_angles(log, rig) for log in logs]
    targets = np.vstack([log.targets for log in samples])
    joints = [j for j, column in enumerate(targets.T) if np.isfinite(column).any()]
    channels = channels_of(rig, "regression")
    of = {"channels": channels.proximal, "positions": channels.positions}
    names = {key: tuple(sensor.name for sensor in sensors) for key, sensors in of.items()}
    seen = Seen.of(samples, names)

    def densities(lag: float, drift: float = 0.0) -> Floats:
        moved = [_late(log, lag, drift) for log in samples]
        tasks = (seen.task(moved, joint, folds)[0] for joint in joints)
        return np.asarray(sum(_best(task) for task in tasks))

    grid = np.arange(EARLIEST, LATEST + STEP / 2, STEP)
    means = [float(np.mean(densities(lag))) for lag in grid]
    best = int(np.argmax(means))
    from scipy.optimize import minimize_scalar  # loaded late: it takes as long as all of distal

    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    search = minimize_scalar(
        lambda lag: -float(np.mean(densities(lag))),
        bounds=bounds,
        method="bounded",
        options={"xatol": 1e-3},
    )
    usual, late = densities(0.0), densities(float(search.x))
    lag = float(search.x)
    if abs(lag) < STEP or not clearly_gains(late - usual):
        return ReferenceLag()
    longest = max(float(np.ptp(log.time)) for log in samples)
    for drift in (0.05 / longest, -0.05 / longest):
        if clearly_gains(densities(lag, drift) - late):
            return ReferenceLag(lag, drift)
    return ReferenceLag(lag)


def _best(task: Task) -> Floats:
    """Return the densities of the logs at the best of a few sizes of the noise."""
    search = [task.densities(replace(Prior(), noise=Prior().noise + more)) for more in (-1, 1, 3)]
    return max(search, key=lambda densities_there: float(np.mean(densities_there)))


def _late(samples: Samples, lag: float, drift: float) -> Samples:
    middle = samples.time - samples.time.mean()
    lags = lag + drift * middle
    targets = [_moved(samples.time, column, lags) for column in samples.targets.T]
    return replace(samples, targets=np.column_stack(targets))


def _moved(time: Floats, values: Floats, lag: float | Floats) -> Floats:
    """Return values at the times that are later by a lag, NaN in gaps and beyond their ends."""
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < 2:
        return values
    stamps = time[finite]
    at = time + lag
    moved = np.interp(at, stamps, values[finite])
    after = np.clip(np.searchsorted(stamps, at), 1, len(finite) - 1)
    gap = stamps[after] - stamps[after - 1] > BRIDGED * np.median(np.diff(stamps))
    outside = (at < stamps[0]) | (at > stamps[-1])
    # only as often as the reference has values: between them nothing new is known
    seen = np.zeros(len(time), dtype=bool)
    seen[finite] = True
    return np.where(gap | outside | ~seen, np.nan, moved)

"""What a fit found: values with standard errors, where each comes from, and the rig with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.rig import Rig

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fitted:
    """One free number after a fit.

    Args:
        name: as asked for.
        paths: in the description.
        si: unit.
        start: where it started, which is the mean of its prior.
        prior_std: of the prior; NaN where there was none.
        value: found.
        error: standard error of it.
        told: whether the logs told it; else it stays at its prior.
        noise: whether it is a noise.
        values: of all `paths`.
        per_log: value by log, where each log has its own.
        kept: whether the file keeps the start where the fit found less.
    """

    name: str
    paths: tuple[str, ...]
    si: str
    start: float
    prior_std: float
    value: float
    error: float
    told: bool
    noise: bool
    values: tuple[float, ...]
    per_log: Mapping[str, float] = field(default_factory=dict)
    kept: bool = False

    @property
    def origin(self) -> str:
        """Where the value comes from, in a word or two."""
        if not self.told:
            return "prior (these logs cannot tell)"
        if self.kept and self.value < self.start:
            return "fitted; the file keeps the start"
        return "mean over the logs" if self.per_log else "fitted"


@dataclass(frozen=True)
class Fit:
    """The outcome of `fit`.

    Args:
        rig: the description with the fitted values.
        start: the description as it came.
        fitted: every free number.
        logs: names of the logs.
        duration: of all of them [s].
        samples: of all of them.
        homing: for how long a reference was used, None for wherever it is [s].
        correlations: of the parameters' errors, (n, n), in the order of `fitted`.
        combinations: plain lines on what the logs cannot tell apart.
        channels: names of the channels that were compared.
        nis_before: mean ν²/S per channel at the start; 1 is expected.
        nis_after: the same at the end.
        cost_before: −ln p at the start, less constants.
        cost_after: at the end.
        iterations: of the search.
        converged: whether the search ended by itself.
        interrupted: whether the user stopped it.
        evaluations: runs of the filter over all logs.
        curves: path → value of what was learned of the position sensors' systematic errors.
    """

    rig: Rig
    start: Rig
    fitted: tuple[Fitted, ...]
    logs: tuple[str, ...]
    duration: float
    samples: int
    homing: float | None
    correlations: Floats
    combinations: tuple[str, ...]
    channels: tuple[str, ...]
    nis_before: tuple[float, ...]
    nis_after: tuple[float, ...]
    cost_before: float
    cost_after: float
    iterations: int
    converged: bool
    interrupted: bool
    evaluations: int
    curves: Mapping[str, object] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Fitted:
        """Return a fitted number by its name or one of its paths.

        Raises:
            KeyError: there is none.
        """
        for part in self.fitted:
            if name == part.name or name in part.paths:
                return part
        raise KeyError(name)

    def save(self, path: str | Path, text: str | None = None) -> None:
        """Write the fitted rig file; what stood there survives a failure.

        Args:
            path: where.
            text: TOML that the values are put into, so that its comments stay; default the description written anew.

        Raises:
            OutputError: it cannot be written.
        """
        from distal.identification.fitted_file import fitted_text
        from distal.logs import write_whole

        write_whole(path, fitted_text(self, text))

    def assignments(self) -> dict[str, Any]:
        """Return path → value (with its std, where it had one) of what changed, as for `Rig.with_values`."""
        from distal.identification.fitted_file import assignments

        return {**assignments(self.fitted, self.start), **self.curves}

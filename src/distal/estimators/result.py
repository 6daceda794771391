"""What an estimator made of a log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.logs import pandas_frame

if TYPE_CHECKING:
    import pandas
    import polars
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

BAND = 1.959963984540054
"""Half-width of a 95 % band in standard deviations."""


@dataclass(frozen=True)
class Estimate:
    """The states over a log, with their standard deviations, and the innovations.

    Args:
        estimator: its name.
        rig: title of the rig.
        time: stamps [s], (k,).
        state_names: names of the n states, ``theta`` [rad] first.
        means: (k, n), SI.
        variances: of the states' errors, (k, n).
        measured: names of the m channels with an innovation.
        innovations: (k, m), NaN where missing, or not compared (a force whose slider is at a stop).
        innovation_variances: (k, m).
        truth: true angle [rad], (k,), where it is known, else None.
        covariances: (k, n, n); None from a batch, where they would fill the memory.
    """

    estimator: str
    rig: str
    time: Floats
    state_names: tuple[str, ...]
    means: Floats
    variances: Floats
    measured: tuple[str, ...]
    innovations: Floats
    innovation_variances: Floats
    truth: Floats | None = None
    covariances: Floats | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def theta(self) -> Floats:
        """Joint angle [rad], (k,)."""
        return self.means[:, 0]

    @property
    def theta_std(self) -> Floats:
        """Standard deviation of the joint angle's error [rad], (k,)."""
        return np.sqrt(self.variances[:, 0])

    @property
    def stds(self) -> Floats:
        """Standard deviations of all states, (k, n)."""
        return np.sqrt(self.variances)

    @property
    def nis(self) -> Floats:
        """Normalised innovation squared per sample, Σ ν²/S over the values that are there, (k,)."""
        nis: Floats = np.nansum(self.innovations**2 / self.innovation_variances, axis=1)
        return nis

    @property
    def log_likelihood(self) -> float:
        """Sum over the log of ln p(sample | past)."""
        there = np.isfinite(self.innovations)
        variances = self.innovation_variances[there]
        return float(-0.5 * np.sum(self.innovations[there] ** 2 / variances + np.log(2 * np.pi * variances)))

    def errors(self, truth: Floats | None = None) -> Floats:
        """Return estimate minus truth [rad], (k,); NaN where the truth is missing.

        Args:
            truth: true angle [rad], (k,); default the log's own.

        Raises:
            EstimationError: no truth is known.
        """
        known = self.truth if truth is None else np.asarray(truth, dtype=np.float64)
        if known is None:
            raise EstimationError("the log has no truth; pass it, or read the log with truth=…")
        return self.theta - known

    def rms_error(self, truth: Floats | None = None) -> float:
        """Return the root mean square of `errors` [rad]."""
        return float(np.sqrt(np.nanmean(self.errors(truth) ** 2)))

    def max_error(self, truth: Floats | None = None) -> float:
        """Return the largest magnitude of `errors` [rad]."""
        return float(np.nanmax(np.abs(self.errors(truth))))

    def inside_band(self, truth: Floats | None = None) -> float:
        """Return the share of samples whose truth is inside the estimate's 95 % band."""
        errors = self.errors(truth)
        there = np.isfinite(errors)
        return float(np.mean(np.abs(errors[there]) <= BAND * self.theta_std[there]))

    def columns(self) -> dict[str, Floats]:
        """Return ``t``, then each state and its ``_std``, SI."""
        columns = {"t": self.time}
        stds = self.stds
        for i, name in enumerate(self.state_names):
            columns[name], columns[f"{name}_std"] = self.means[:, i], stds[:, i]
        return columns

    def to_polars(self) -> polars.DataFrame:
        """Return the `columns` as a polars frame."""
        import polars

        return polars.DataFrame(self.columns())

    def to_pandas(self) -> pandas.DataFrame:
        """Return the `columns` as a pandas frame.

        Raises:
            DistalError: pandas is not installed.
        """
        return pandas_frame(self.columns())

    def plot(self, path: str | Path | None = None, **options: Any) -> Figure:
        """Draw truth, estimate and 95 % band over time, and save it if a path is given.

        Args:
            path: where to save (PNG, SVG or PDF by its suffix); None only returns the figure.
            options: see `distal.estimators.plot_estimates`.
        """
        from distal.estimators.traces import plot_estimates

        return plot_estimates([self], path=path, **options)

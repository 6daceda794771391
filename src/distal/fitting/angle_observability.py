"""Observability of a joint's angle along a log: where the sensors show it, by the filter's own
linearisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.errors import FitError
from distal.estimators import AdaptiveFilter, Directions, directions, first_values
from distal.homing import check_homing, with_references
from distal.kernels import Feed, advance, covariance_of, variances_of
from distal.logs import Log
from distal.results import (
    COLOURS,
    DASHES,
    Estimate,
    figure,
    from_start,
    legend_above,
    save_figure,
    time_label,
)
from distal.rig import Rig, Sensor
from distal.run import estimate, samples_of, with_channel

if TYPE_CHECKING:
    from matplotlib.figure import Figure


START_STD = np.deg2rad(10.0)
"""Standard deviation of the angle that is assumed at the start of each window [rad]. Source:
judgement.
"""

SEEN = 0.2
"""Ratio of the std at a window's end to `START_STD`, below which the angle is seen. Source:
judgement.
"""

HARDLY = 0.7
"""The same ratio, below which the angle is hardly seen. Source: judgement."""

OBSERVED_WINDOW = 0.5
"""Default length of the windows [s]. Source: judgement."""


@dataclass(frozen=True)
class Observability:
    """How well the sensors find a joint's angle again that is assumed as lost, along a log.

    Args:
        time: stamps [s], (k,).
        found: std of the angle that was `START_STD` at the start of a window, as the window's
            sensors find it again [rad], (k,).
        std: std of the angle along the whole log [rad], (k,).
        window: length of the windows [s].
        estimate: the estimate along the log.
        joint: index of the joint.
        directions: directions of joint space that the sensors miss.
    """

    time: Floats
    found: Floats
    std: Floats
    window: float
    estimate: Estimate
    joint: int = 0
    directions: Directions | None = None

    def table(self, rows: int = 10) -> list[tuple[float, float, float, float, str]]:
        """Return (from [s], to [s], std [rad], std found again [rad], word) for equal parts of the
        log, as many as `rows`.
        """
        edges = np.linspace(self.time[0], self.time[-1], rows + 1)
        # the std at a window's end is what the whole window found
        number = np.floor((self.time - self.time[0]) / self.window).astype(int)
        ends = np.flatnonzero(np.diff(number, append=number[-1] + 1) > 0)
        lines = []
        for low, high in pairwise(edges):
            part = (self.time >= low) & (self.time <= high)
            inside = [i for i in ends if low <= self.time[i] <= high]
            regained = float(np.median(self.found[inside if inside else part]))
            share = regained / START_STD
            word = "seen" if share < SEEN else "hardly seen" if share < HARDLY else "not seen"
            lines.append(
                (float(low), float(high), float(np.median(self.std[part])), regained, word)
            )
        return lines

    def plot(self, path: str | Path | None = None) -> Figure:
        """Draw the angle with its band, and how well it is found again where it was lost; save the
        figure if a path is given.
        """
        with figure(2, 1, (6.5, 4.8), sharex=True) as (drawing, (angle, spread)):
            since = from_start(self.time)
            theta = np.rad2deg(self.estimate.angles[:, self.joint])
            half = np.rad2deg(BAND * self.std)
            angle.fill_between(
                since,
                theta - half,
                theta + half,
                color=COLOURS[0],
                alpha=0.25,
                lw=0,
                label="95 % band",
            )
            angle.plot(since, theta, color=COLOURS[0], lw=1.2, label="estimate")
            angle.set_ylabel("joint angle θ [°]")
            legend_above(angle)
            label = f"lost by {np.rad2deg(START_STD):g}° every {self.window:g} s, and found again"
            spread.semilogy(
                since, np.rad2deg(self.found), color=COLOURS[1], ls=DASHES[1], lw=1.2, label=label
            )
            spread.semilogy(
                since, np.rad2deg(self.std), color=COLOURS[0], lw=1.2, label="along the log"
            )
            spread.set_ylabel("std of the angle [°]")
            spread.set_xlabel(time_label(self.time))
            legend_above(spread)
        if path is not None:
            save_figure(drawing, path)
        return drawing


def observability(
    log: Log,
    rig: Rig,
    window: float = OBSERVED_WINDOW,
    homing: float | None = None,
    joint: str | None = None,
) -> Observability:
    """Return how well the sensors show the angle of a joint along a log.

    At the start of each window the angle's variance is set to `START_STD`², uncorrelated with
    everything else, and the filter's own covariance recursion goes on. At the window's end, 1/P −
    1/START_STD² is the angle's entry in the window's observability Gramian, with process noise and
    the other unknowns taken into account (Krener and Ide, CDC 2009). Where the angle is not found
    again, friction, slack or stops hide the joint, and only the model's memory holds the angle.

    Args:
        window: length of the windows [s].
        homing: for how long the reference is read [s], see `estimate`.
        joint: name of the joint; default the first.

    Raises:
        FitError: the window does not fit the log, or the rig has no such joint.
        EstimationError: as `estimate`.
    """
    if not isinstance(log, Log):
        raise FitError(f"observability takes one Log (see read_log), {type(log).__name__} came")
    span = float(log.time[-1] - log.time[0])
    if not 0.0 < window < span:
        raise FitError(
            f"the window must be longer than 0 s and shorter than the log ({span:g} s), "
            f"{window:g} s came"
        )
    joints = rig.joint_names
    if joint is not None and joint not in joints:
        raise FitError(
            f"observability: no joint is called {joint!r}; the rig has {', '.join(joints)}"
        )
    at = 0 if joint is None else joints.index(joint)
    estimated = estimate(log, rig, homing=homing)
    references: tuple[Sensor, ...] = ()
    if homing is not None:
        rig, references = with_references(rig, log)
        true = check_homing(homing, log, joints)
        early = log.time - log.time[0] < homing
        for sensor in references:
            log = with_channel(
                log, sensor.name, np.where(early, true[:, joints.index(sensor.of)], np.nan)
            )
    estimator = AdaptiveFilter(rig, references=references)
    samples = samples_of(log, estimator.channels)
    belief = estimator.initial(log.time[0], first_values(samples))
    rows, last = estimator.rows(np.diff(log.time, prepend=log.time[0]), samples)
    kernel_states = advance(
        estimator.kernel, Feed(belief.kernel_state, rows, estimator.parameters)
    ).kernel_states
    std = estimated.angle_stds[:, at]
    regained = np.array(std)
    number = np.floor((log.time - log.time[0]) / window).astype(int)
    n = len(estimator.state_names)
    for k in range(int(number[-1]) + 1):
        inside = np.flatnonzero(number == k)
        if len(inside) == 0:
            continue
        start = last[inside[0] - 1] + 1 if inside[0] else 0
        kernel_state = np.array(kernel_states[start - 1] if start else belief.kernel_state)
        covariance = covariance_of(kernel_state, n)
        covariance[at, :] = covariance[:, at] = 0.0
        covariance[at, at] = START_STD**2
        after = advance(
            estimator.kernel,
            Feed(kernel_state, rows[start : last[inside[-1]] + 1], estimator.parameters),
        ).kernel_states
        regained[inside] = np.sqrt(
            np.maximum(variances_of(after[last[inside] - start], n)[:, at], 0.0)
        )
    return Observability(
        log.time, np.maximum(regained, std), std, window, estimated, at, directions(rig)
    )

"""The band of an estimate: the share of errors that it is to hold, and its half-width in standard
deviations; and thresholds by which finished and live estimates are judged alike.
"""

from __future__ import annotations

from statistics import NormalDist

from distal.errors import EstimationError

COVERED = 0.95
"""Share of the errors that a band is to hold [1]. Source: definition (95 % band)."""

BAND = NormalDist().inv_cdf((1 + COVERED) / 2)
"""Half-width of that band in standard deviations of a normal distribution, its 97.5 % quantile [1].
Source: definition (quantile).
"""


def half_width(level: float) -> float:
    """Return the half-width of a band that is to hold a share of the errors [standard deviations of
    a normal distribution].

    Raises:
        EstimationError: `level` is not between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise EstimationError(
            "a level is the share of errors that a band is to hold, between 0 and 1; "
            f"{level:g} came"
        )
    return NormalDist().inv_cdf((1 + level) / 2)


def in_percent(level: float) -> str:
    """Return a level as it stands beside a band: 0.95 is `95 %`."""
    return f"{100 * level:.4g} %"


COVERED_TEXT = in_percent(COVERED)
"""That share as texts, tables and pages have it."""

SMALL = 0.05
"""Mean of ν²/S below which a channel tests nothing: the filter's own uncertainty, not the channel's
noise, then makes up most of S. Source: judgement.
"""

CLEARLY = 3.0
"""Two numbers differ clearly where they are so many standard deviations of their difference apart
[1]. Source: definition (three standard deviations: level 0.27 % of a normal distribution).
"""

LARGE_PRIOR = CLEARLY
"""A state has left its prior where it differs from the prior mean by more than this many prior
standard deviations and its own standard deviation.
"""

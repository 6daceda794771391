"""The band of an estimate: the share of errors that it is to hold, and its half-width in standard
deviations; and thresholds by which finished and live estimates are judged alike.
"""

from __future__ import annotations

from statistics import NormalDist

COVERED = 0.95
"""Share of the errors that a band is to hold [1]. Source: definition (95 % band)."""

BAND = NormalDist().inv_cdf((1 + COVERED) / 2)
"""Half-width of that band in standard deviations of a normal distribution, its 97.5 % quantile [1].
Source: definition (quantile).
"""


COVERED_TEXT = f"{100 * COVERED:g} %"
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

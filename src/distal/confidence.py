"""How much a band is to hold: its share of the errors, and the half-width in standard deviations
that goes with it.
"""

from __future__ import annotations

from statistics import NormalDist

COVERED = 0.95
"""Share of the errors that a band is to hold."""

BAND = NormalDist().inv_cdf((1 + COVERED) / 2)
"""Half-width of that band in standard deviations of a normal distribution: its 97.5 % quantile."""

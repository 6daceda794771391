"""Thresholds by which a finished estimate and a live one are judged alike."""

SMALL = 0.05
"""Mean of ν²/S below which a channel tests nothing: S is then not its noise but what the filter
does not believe of it.
"""

LARGE_PRIOR = 3.0
"""A state this many prior standard deviations from its prior mean, its own doubt taken off, has
left its prior.
"""

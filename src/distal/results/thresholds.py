"""Thresholds by which finished and live estimates are judged alike."""

SMALL = 0.05
"""Mean of ν²/S below which a channel tests nothing: the filter's own uncertainty, not the channel's
noise, then makes up most of S. Source: judgement.
"""

LARGE_PRIOR = 3.0
"""A state has left its prior where it differs from the prior mean by more than this many prior
standard deviations and its own standard deviation. Source: judgement.
"""

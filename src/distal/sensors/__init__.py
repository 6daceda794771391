"""Sensor models: what a real sensor makes of a true value."""

from distal.sensors.errors import linearity_curve, measure, place_offsets, systematic_variance, variance

__all__ = ["linearity_curve", "measure", "place_offsets", "systematic_variance", "variance"]

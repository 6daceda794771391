"""Sensor models: what a real sensor makes of a true value."""

from distal.sensors.errors import (
    LINEARITY_STD,
    Curves,
    SensorErrors,
    measure,
    place_offsets,
    quantisation_variance,
    quantised,
    quantised_symbol,
    systematic_variance,
    variance,
)

__all__ = [
    "LINEARITY_STD",
    "Curves",
    "SensorErrors",
    "measure",
    "place_offsets",
    "quantisation_variance",
    "quantised",
    "quantised_symbol",
    "systematic_variance",
    "variance",
]

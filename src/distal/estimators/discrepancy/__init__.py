"""The model's own error as learned from logs: a correction of the angle and its variance (Kennedy and O'Hagan, 2001)."""

from distal.estimators.discrepancy.homing import homed
from distal.estimators.discrepancy.kernel import corrected_function, first_memory, memory_size, numbers_of
from distal.estimators.discrepancy.samples import Samples, corrected, design, outside
from distal.estimators.discrepancy.terms import columns, played, variables

__all__ = [
    "Samples",
    "columns",
    "corrected",
    "corrected_function",
    "design",
    "first_memory",
    "homed",
    "memory_size",
    "numbers_of",
    "outside",
    "played",
    "variables",
]

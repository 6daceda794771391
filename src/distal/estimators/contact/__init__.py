"""The torque on a joint from outside as learned from logs in which it was measured."""

from distal.estimators.contact.homing import homed
from distal.estimators.contact.kernel import first_memory, memory_size, numbers_of, touched_function
from distal.estimators.contact.terms import design, slips

__all__ = ["design", "first_memory", "homed", "memory_size", "numbers_of", "slips", "touched_function"]

"""`affine`, the obvious estimator: least squares of what the sensors read, from logs or a homing move."""

from distal.estimators.affine.estimator import NEEDS, OUTSIDE, AffineEstimator
from distal.estimators.affine.homing import NORMAL, after_window, corrected, learned_alone, student
from distal.estimators.affine.learning import conformal_factor, learned, random_effects, sized
from distal.estimators.affine.mapping import design, noise_of, outside, predicted
from distal.estimators.affine.readings import NAME, Readings, dead_bands, direction, readings_of
from distal.estimators.affine.regression import correlated_samples, line, surprise, updated
from distal.estimators.affine.start import start_of

__all__ = [
    "NAME",
    "NEEDS",
    "NORMAL",
    "OUTSIDE",
    "AffineEstimator",
    "Readings",
    "after_window",
    "conformal_factor",
    "corrected",
    "correlated_samples",
    "dead_bands",
    "design",
    "direction",
    "learned",
    "learned_alone",
    "line",
    "noise_of",
    "outside",
    "predicted",
    "random_effects",
    "readings_of",
    "sized",
    "start_of",
    "student",
    "surprise",
    "updated",
]

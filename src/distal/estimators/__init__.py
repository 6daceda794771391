"""Estimators behind one contract: belief and sample in, belief and innovation out."""

from distal.estimators.adaptive import AdaptiveFilter
from distal.estimators.augmented import parameter_states
from distal.estimators.batch import estimate_batch
from distal.estimators.channels import Channels, channels_of
from distal.estimators.contract import Belief, Estimator, Innovation, KernelEstimator
from distal.estimators.diagnosis import Diagnosis, diagnose
from distal.estimators.estimate import HOMED, estimate, first_values, samples_of, with_channel
from distal.estimators.force_update import WILD_FORCE
from distal.estimators.full_state import FullStateFilter, Noise, paper_noise, rig_noise, state_units
from distal.estimators.health import HEALTH, Monitor, Reading
from distal.estimators.kinematic import KinematicEstimator
from distal.estimators.live import LiveEstimator
from distal.estimators.particle import ParticleFilter
from distal.estimators.reference import TRUTH_NOISE, added_reference, check_homing, with_reference
from distal.estimators.registry import DEFAULT, ESTIMATORS, SLOW, make_estimator
from distal.estimators.result import BAND, Estimate
from distal.estimators.smoothing import smooth
from distal.estimators.traces import COLOURS, DASHES, draw_estimate, figure, plot_estimates, plot_kind, save_figure
from distal.estimators.unscented import UnscentedFilter

__all__ = [
    "BAND",
    "COLOURS",
    "DASHES",
    "DEFAULT",
    "ESTIMATORS",
    "HEALTH",
    "HOMED",
    "SLOW",
    "TRUTH_NOISE",
    "WILD_FORCE",
    "AdaptiveFilter",
    "Belief",
    "Channels",
    "Diagnosis",
    "Estimate",
    "Estimator",
    "FullStateFilter",
    "Innovation",
    "KernelEstimator",
    "KinematicEstimator",
    "LiveEstimator",
    "Monitor",
    "Noise",
    "ParticleFilter",
    "Reading",
    "UnscentedFilter",
    "added_reference",
    "channels_of",
    "check_homing",
    "diagnose",
    "draw_estimate",
    "estimate",
    "estimate_batch",
    "figure",
    "first_values",
    "make_estimator",
    "paper_noise",
    "parameter_states",
    "plot_estimates",
    "plot_kind",
    "rig_noise",
    "samples_of",
    "save_figure",
    "smooth",
    "state_units",
    "with_channel",
    "with_reference",
]

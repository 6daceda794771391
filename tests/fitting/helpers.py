"""Simulated logs of a rig whose plant differs from its description: those of `make accuracy`."""

from benchmarks.fitting import FREE, drawn_plant, logs_of, start_rig, without_truth

__all__ = ["FREE", "drawn_plant", "logs_of", "start_rig", "without_truth"]

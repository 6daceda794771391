"""Self-diagnosis: what was tested, what disagrees, and what no sensor there can test."""

from distal.results.diagnosis.channels import LARGE, SMALL, Channels, channels_of
from distal.results.diagnosis.diagnosis import Diagnosis, diagnose
from distal.results.diagnosis.finding import Finding, Kind
from distal.results.diagnosis.states import LARGE_PRIOR

__all__ = ["LARGE", "LARGE_PRIOR", "SMALL", "Channels", "Diagnosis", "Finding", "Kind", "channels_of", "diagnose"]

"""Diagnosis of an estimate: what was tested, what disagrees, and what no sensor in the log can
test.
"""

from distal.diagnosis.causes import Finding, Kind
from distal.diagnosis.diagnose import diagnose, why_diverged
from distal.diagnosis.innovation_tests import Diagnosis, diagnose_estimate

__all__ = [
    "Diagnosis",
    "Finding",
    "Kind",
    "diagnose",
    "diagnose_estimate",
    "why_diverged",
]

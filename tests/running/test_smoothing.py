"""The smoother against the filter."""

from __future__ import annotations

import numpy as np
from benchmarks.cases import paper_log, paper_rig

from distal import Estimate, estimate, smooth
from tests.helpers import rms_degrees


def pooled(results: list[Estimate]) -> tuple[float, float]:
    """Return RMS error [°] and share inside the 95 % band of all logs together."""
    return (
        rms_degrees(np.concatenate([result.errors() for result in results])),
        float(np.mean([result.inside_band() for result in results])),  # logs of one length
    )


def test_the_smoother_is_no_less_sure_and_no_worse() -> None:
    rig = paper_rig("as the rig")
    logs = [paper_log("servo", "friction +20 %", seed) for seed in range(6)]
    filtered, smoothed = [estimate(log, rig) for log in logs], [smooth(log, rig) for log in logs]
    for one, other in zip(filtered, smoothed):
        np.testing.assert_allclose(other.theta[-1], one.theta[-1], rtol=1e-9)
        assert np.all(other.theta_std <= one.theta_std * (1 + 1e-6))
    assert pooled(smoothed)[0] < pooled(filtered)[0]
    assert pooled(smoothed)[1] > 0.85

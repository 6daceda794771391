"""Self-diagnosis: which sensor disagrees, from when on, and what could not be compared."""

from __future__ import annotations

import numpy as np
from benchmarks.cases import paper_log, paper_rig

from distal import Log, diagnose, estimate


def changed(log: Log, **channels: np.ndarray) -> Log:
    return Log(log.time, {**log.channels, **channels}, dict(log.truth), log.source)


def test_diagnosis() -> None:
    log, rig = paper_log("servo", "as the rig", 0), paper_rig("as the rig")
    assert diagnose(estimate(log, rig)).consistent
    drift = np.where(log.time > 6.0, 4.0 * np.minimum(log.time - 6.0, 1.0), 0.0)
    text = diagnose(estimate(changed(log, u2=log.channels["u2"] + drift), rig)).text
    assert text.startswith("sensor u2 disagrees from ")
    assert 5.5 <= float(text.split("from ")[1].split(" s")[0]) <= 8.0
    noisy = changed(
        log, **{f"u{i}": log.channels[f"u{i}"] + np.random.default_rng(i).normal(0, 0.9, len(log)) for i in (1, 2)}
    )
    assert "larger than expected" in diagnose(estimate(noisy, rig)).text
    assert "not checked" in diagnose(estimate(log, rig, "elastic")).text


def test_undeclared_friction_is_named() -> None:
    plant = "slider friction 1 N"
    text = diagnose(estimate(paper_log("servo", plant, 0), paper_rig(plant))).text
    assert "friction that the rig does not have" in text
    assert "'left'" in text


def test_what_is_not_compared_is_said() -> None:
    """A window of the stops that is far too small: forces count for nothing, and that is said."""
    log, rig = paper_log("servo", "as the rig", 0), paper_rig("as the rig")
    narrow = rig.with_values({f"drives.{i}.stops": [0.0, 0.002] for i in range(2)})
    result = estimate(log, narrow)
    assert np.mean(np.isfinite(result.innovations)) < 0.5
    text = diagnose(result).text
    assert "could be compared" in text
    assert "could be compared" not in diagnose(estimate(log, rig)).text

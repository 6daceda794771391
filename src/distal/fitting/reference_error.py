"""What the reference itself errs by: bands that were learned from it are no narrower than its offset is unsure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.logs import Log, TruthKind
from distal.rig import LearnedMap, Rig


def with_reference_error(learned: LearnedMap, rig: Rig, logs: Sequence[Log]) -> LearnedMap:
    """Return a map of the angle with the std of the reference's offset in its band: c² s² becomes c² s² + σ_b².

    An encoder that is mounted 0.2° off is so in all logs, so that no log left out shows it. The rig's angle sensors say how
    unsure their offsets are.
    """
    if not any(log.truth_kind is TruthKind.SENSOR for log in logs):
        return learned
    offsets = {sensor.of: sensor.bias.filter_std for sensor in reversed(rig.sensors_of("angle"))}
    joints = tuple(
        joint.model_copy(update={"std": float(np.hypot(joint.std, offsets.get(joint.joint, 0.0) / band))})
        for joint, band in zip(learned.joints, learned.band)
    )
    return learned.model_copy(update={"joints": joints})

"""What the reference itself errs by: bands that were learned from it are no narrower than its offset is unsure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distal.fitting.affine import AffineFit
from distal.fitting.discrepancy import DiscrepancyFit
from distal.logs import Log
from distal.rig import AffineJoint, Rig


def with_reference_error(
    affine: AffineFit | None, discrepancy: DiscrepancyFit | None, rig: Rig, logs: Sequence[Log]
) -> tuple[AffineFit | None, DiscrepancyFit | None]:
    """Return what was learned, with the std of the reference's offset in the bands: s² becomes s² + σ_b².

    An encoder that is mounted 0.2° off is so in all logs, so that no log left out shows it.

    Args:
        affine: what was learned of the angle.
        discrepancy: what was learned of the model's error.
        rig: the description, whose angle sensors say how unsure their offsets are.
        logs: from which it was learned.
    """
    if not any(log.truth_kind.by_sensor for log in logs):
        return affine, discrepancy
    offsets = {sensor.of: sensor.bias.filter_std for sensor in reversed(rig.sensors_of("angle"))}

    def wider(joint: AffineJoint, name: str) -> AffineJoint:
        return joint.model_copy(update={"std": float(np.hypot(joint.std, offsets.get(name, 0.0)))})

    names = [joint.name for joint in rig.joints]
    if affine is not None:
        joints = tuple(wider(joint, name) for joint, name in zip(affine.affine.joints, names))
        learned_map = affine.affine.model_copy(update={"joints": joints})
        affine = replace(affine, rig=affine.rig.model_copy(update={"affine": learned_map}))
    if discrepancy is not None:
        joints = tuple(wider(joint, name) for joint, name in zip(discrepancy.discrepancy.joints, names))
        learned = discrepancy.discrepancy.model_copy(update={"joints": joints})
        described = discrepancy.rig.model_copy(update={"discrepancy": learned})
        discrepancy = replace(discrepancy, rig=described)
    return affine, discrepancy

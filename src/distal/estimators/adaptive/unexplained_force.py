"""Forces that stay unexplained: evidence of a torque that the rig does not declare. Equations
(13b), (29), (30).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from distal.estimators.adaptive.context import FilterContext
from distal.estimators.adaptive.tuning import Robustness
from distal.expressions import ScalarNode, VectorNode
from distal.kernels.layout import Layout

EVIDENCE_TIME = 0.05
"""Time constant of the mean normalised innovation of a drive's force [s]."""

MOST_INNOVATION = 3.0
"""One sample counts as no more standard deviations than this [1]: an outlier opens nothing."""

UNEXPLAINED = 0.7
"""A mean normalised innovation beyond this stays unexplained [1]: docs/results/chains.md,
"Something happens".
"""

OPENED = 14.0
"""So many times the part of an innovation that stays unexplained is the std of the force that may
act [1].
"""

CLOSING_TIME = 1.2
"""Time constant with which it is forgotten once forces are explained again [s]."""

USUAL_TIME = 2.5
"""Time constant of what is usual of a force [s]."""

UNUSUAL = 4.0
"""What is so many times as large as usual is an event; a rig that lacks some physics is always a
little off [1].
"""

FORCE = Layout(friction=1, innovation=1, usual=1, opened=1)
"""What is remembered of a drive's force: of its friction (see `Comparison`), its mean normalised
innovation, the mean square of that [1], and the variance of the force that may act beside what the
rig declares [N², (N m)²].
"""


def watched(robustness: Robustness) -> ca.Function:
    """Return (z̄, w, o², ν, S, used, dt) → (z̄⁺, w⁺, o²⁺) of a drive's force: (29), (30)."""
    mean, usual, opened, innovation, variance, used, dt = (
        ca.SX.sym(name) for name in ("z", "w", "o", "nu", "S", "used", "dt")
    )
    arguments = [mean, usual, opened, innovation, variance, used, dt]
    if not robustness.opens_torques:
        return ca.Function("watch", arguments, [mean, usual, opened])
    shown = ca.fmin(
        ca.fmax(innovation / ca.sqrt(ca.fmax(variance, 1e-30)), -MOST_INNOVATION), MOST_INNOVATION
    )
    fade, slowly = ca.exp(-dt / EVIDENCE_TIME), ca.exp(-dt / USUAL_TIME)
    after = ca.if_else(used > 0, fade * mean + (1 - fade) * shown, mean)
    threshold = ca.fmax(UNEXPLAINED, UNUSUAL * ca.sqrt(usual))
    excess = OPENED * (1 - threshold / ca.fmax(ca.fabs(after), threshold))
    taken = ca.if_else(
        used > 0, excess**2 * ca.fmin(innovation**2, MOST_INNOVATION**2 * variance), 0
    )
    level = ca.if_else(used > 0, slowly * usual + (1 - slowly) * after**2, usual)
    return ca.Function(
        "watch", arguments, [after, level, ca.fmax(opened * ca.exp(-2 * dt / CLOSING_TIME), taken)]
    )


def opened_torque(
    context: FilterContext, joint: int, opened: Sequence[ScalarNode], p: VectorNode
) -> ScalarNode:
    """Return the variance of the torque that may act on a joint beside what the rig declares [(N
    m)²]: (13b).

    A force of a drive is that torque at the moment arm of its tendons; `opened` are the forces'
    variances, by drive.
    """
    total = ca.MX(0)
    for i, names in context.moved_by(joint).items():
        ratio, share = ca.vertsplit(context.numbers(p, names))
        # a torque on one of several joints of a tendon changes its tension by that share of what it
        # would alone
        total += opened[i] / (ratio * share) ** 2
    return total

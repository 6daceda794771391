"""Update: what is compared corrects the state, one row after the other. Equations (22) to (26)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.interval import Interval, Prediction
from distal.estimators.adaptive.measurement import Row, row_functions
from distal.estimators.adaptive.robustness import Robustness, robust_variance
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.stick_slip import Comparison, Residual, compared
from distal.estimators.kalman import lowered
from distal.expressions import MatrixNode, ScalarNode, VectorNode
from distal.kernels.mask import is_there, share_used


def updated(
    states: StateVector,
    prediction: Prediction,
    rates: VectorNode,
    memory: Sequence[ScalarNode],
    interval: Interval,
    loops: bool,
) -> tuple[VectorNode, MatrixNode, list[ScalarNode], VectorNode]:
    """Return mean, covariance, what is remembered of each drive's force, and (innovations, variances) after a sample.

    For each row with slope a of what is expected: ν, S = a P aᵀ + R, S' by `robust_variance`, x⁺ = x + P aᵀ ν/S',
    P⁺ = P − P aᵀ a P/S': equations (22) to (26).

    Args:
        states: the state vector.
        prediction: for the sample; it is not changed.
        rates: mean speed of each drive over the interval.
        memory: what is remembered of each drive's force; see `Comparison`.
        interval: with its sample.
        loops: whether this stays a function of matrices.
    """
    prior, covariance = prediction.state, prediction.covariance
    tracks, x, p = interval.tracks, interval.x, interval.p
    rows, table = row_functions(states)
    values, *slopes = table(prior, tracks, rates, x, p)
    mean, kept, innovations, spreads = prior, list(memory), list[ScalarNode](), list[ScalarNode]()
    for k, row in enumerate(rows):
        slope, limit_slope, asymmetry_slope = own = slopes[3 * k : 3 * k + 3]
        ahead = [ca.mtimes(covariance, each) for each in own]
        since = [_along(each, mean - prior) for each in own]
        numbers = ca.vertcat(*since, _along(slope, ahead[0]), _along(limit_slope, ahead[1]))
        remembered = ca.MX(0) if row.drive is None else kept[row.drive]
        innovation, own_variance, after, by_limit, by_asymmetry, counts = comparison_function(states, row)(
            values[5 * k : 5 * k + 5], ca.vertcat(numbers, remembered), tracks, x, p
        )
        across = -ahead[0]
        for share, each, there in ((by_limit, ahead[1], limit_slope), (by_asymmetry, ahead[2], asymmetry_slope)):
            across = across + share * each if there.nnz() else across
        spread = -_along(slope, across)
        spread += by_limit * _along(limit_slope, across) + by_asymmetry * _along(asymmetry_slope, across)
        weight, root, shown = weights(states.context.robustness, row.trusted)(
            spread + own_variance, innovation, values[5 * k + 4], counts
        )
        change = (weight * innovation) * across
        shares = states.gain_shares(row.drive, row.trusted)
        for at, share in shares.items():
            change[at] *= share
        if row.drive is not None:
            # a mean residual moves with the state; a time does not
            declared = states.context.declares_friction(row.drive)
            kept[row.drive] = after + _along(slope, change) if declared else after
        mean = mean + change
        covariance = reduced(shares, covariance, root * across, loops)
        innovations.append(shown)
        spreads.append(spread + own_variance)
    measured = [k for k, row in enumerate(rows) if row.measured]
    y = ca.vertcat(*(innovations[k] for k in measured), *(spreads[k] for k in measured))
    return mean, covariance, kept, y


def reduced(shares: Mapping[int, float], covariance: MatrixNode, root: VectorNode, loops: bool) -> MatrixNode:
    """Return the covariance after a row (25): states that take a share κ of the gain keep what they do not learn.

    With g = P Aᵀ/√S' and K = κ g/√S', (25) is P_ij − g_i g_j + (1 − κ_i) g_i (1 − κ_j) g_j.

    Args:
        shares: κ of each state that does not take all of the gain.
        covariance: before.
        root: g; zero for a row that does not count.
        loops: whether this stays a function of matrices.
    """
    after = lowered(covariance, root, loops)
    if shares:
        at = list(shares)
        kept = root[at] * ca.DM([1.0 - share for share in shares.values()])
        after[at, at] += ca.mtimes(kept, kept.T)
    return after


def _along(slope: VectorNode, values: VectorNode) -> ScalarNode:
    """Return a slope times a vector."""
    return ca.mtimes(slope.T, values) if slope.nnz() else ca.MX(0)


def comparison_function(states: StateVector, row: Row) -> ca.Function:
    """Return (values, numbers, tracks, x, p) → `Comparison` of one row.

    Numbers are the changes of residual, limit and asymmetry since the prior, the variances of residual and limit by the
    state's, and what is remembered of the drive.

    Args:
        states: the state vector.
        row: which.
    """
    context = states.context
    values, numbers = ca.SX.sym("values", 5), ca.SX.sym("numbers", 6)
    vector, x = ca.SX.sym("tracks", Tracks.size(context.n_drives)), ca.SX.sym("x", context.width)
    residual, limit, asymmetry = (values[i] + numbers[i] for i in range(3))
    if row.drive is None:
        comparison = Comparison(residual, values[3], numbers[5])
    else:
        whole = Residual(
            residual, ca.fmax(limit, 0), asymmetry, values[3], numbers[4], numbers[3], numbers[5], values[4]
        )
        comparison = compared(context, row.drive, Tracks(vector, context.n_drives)[row.drive], whole, x[0])
    parts = [getattr(comparison, name) for name in Comparison.__dataclass_fields__]
    arguments = [values, numbers, vector, x, context.mechanism.parameters.symbols]
    return ca.Function("compare", arguments, ca.cse([ca.densify(ca.SX(part)) for part in parts]))


def weights(robustness: Robustness, trusted: bool) -> ca.Function:
    """Return (S, ν, mask, counts) → (1/S' where it is used, its root, ν to show), see `robust_variance`.

    What is not compared (its drive at a stop) has no innovation to show.

    Args:
        robustness: the guards.
        trusted: never taken as wild.
    """
    spread, innovation, mask, counts = (ca.SX.sym(name) for name in ("S", "nu", "mask", "counts"))
    robust = spread if trusted else robust_variance(robustness, spread, innovation)
    weight = share_used(mask) / robust
    shown = ca.if_else(ca.logic_and(is_there(mask), counts), innovation, np.nan)
    return ca.Function("weights", [spread, innovation, mask, counts], [weight, ca.sqrt(weight), shown])

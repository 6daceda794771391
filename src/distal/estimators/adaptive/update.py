"""Update the state by the comparisons, one row after the other, unless a stop may hold a joint.
Equations (22) to (26).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from distal.estimators.adaptive.drive_friction import Comparison, Residual, compared
from distal.estimators.adaptive.drive_tracking import TRACKED, Drive, Tracks
from distal.estimators.adaptive.filter_inputs import Interval, Prediction
from distal.estimators.adaptive.guards import Robustness, robust_variance
from distal.estimators.adaptive.measurement import ROW, SLOPED, MeasurementRow, Rows
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.touch import (
    FORCE,
    Remembered,
    evidence_function,
    open_torques,
)
from distal.estimators.kalman import Downdate, along
from distal.expressions import MatrixNode, ScalarNode, VectorNode
from distal.kernels.layout import Layout, is_there, share_used


def depths_in_stops(states: StateVector, mean: VectorNode, p: VectorNode) -> dict[int, ScalarNode]:
    """Return joint → depth of its angle in its stop, negative before it [rad]; joints without stops
    are left out.

    It is at a `mean`, (n,), with the kernel's parameters p.
    """
    mechanism = states.context.mechanism
    names = mechanism.parameters.names
    depths = dict[int, ScalarNode]()
    for j, joint in enumerate(mechanism.rig.joints):
        if joint.stops is not None:
            low, high = (p[names.index(f"joints.{j}.stops.{end}")] for end in ("low", "high"))
            depths[j] = ca.fmax(mean[j] - high, low - mean[j])
    return depths


SINCE = Layout(residual=1, limit=1, asymmetry=1, residual_variance=1, limit_variance=1, memory=1)
"""Layout of the changes of a row since the prior by the rows before it, the variances of its
residual and limit from the state's covariance (r_x P r_xᵀ, l_x P l_xᵀ), and what is remembered of
its drive. Source: definition (layout of a vector).
"""

SMALLEST_VARIANCE = 1e-30
"""Smallest variance of a row's innovation [SI²], so that 0/0 is 0, also in float, for a row that
tells nothing (a drive without a force sensor, its tendons slack). Source: rounding (division by
zero).
"""


def updated(
    states: StateVector,
    prediction: Prediction,
    rates: VectorNode,
    kept: Remembered,
    interval: Interval,
) -> tuple[VectorNode, MatrixNode, VectorNode]:
    """Return mean, covariance, and (innovations, variances) after a sample; `kept` changes in
    place.

    For each row with slope A of the expected value: ν, S = A P Aᵀ + R', S' by `robust_variance`, m⁺
    = m + P Aᵀ ν/S', P⁺ = P − P Aᵀ A P/S'. States that take only a share of the gain change by
    equations (24) and (25).

    Args:
        prediction: for the sample; it is not changed.
        rates: mean speed of each drive over the interval.
        kept: what is remembered of forces and of torques on the joints.
        interval: with its sample.
    """
    prior = prediction.state
    covariance = Downdate(prediction.covariance)
    tracks = interval.tracks
    x = interval.x
    p = interval.p
    dt = interval.x[0]
    rows = Rows.of(states).at(prior, tracks, rates, x, p)
    mean = prior
    innovations = list[ScalarNode]()
    spreads = list[ScalarNode]()
    nominal = states.context.parameters(p, ["interval"])
    evidence = dict[str, dict[str, ScalarNode]]()
    watch = evidence_function()
    touched = kept.touched
    fixed = np.flatnonzero(states.lasting).tolist()
    for at in rows:
        row = at.row
        slopes = at.slopes
        moved = mean - prior
        by = {part: covariance.times(slope) for part, slope in slopes.items()}
        since = SINCE.joined(
            **{part: along(slope, moved) for part, slope in slopes.items()},
            residual_variance=along(slopes["residual"], by["residual"]),
            limit_variance=along(slopes["limit"], by["limit"]),
            memory=ca.MX(0) if row.drive is None else kept.drives[row.drive]["friction"],
        )
        followed = ca.MX.zeros(len(TRACKED)) if row.drive is None else Tracks(tracks).of(row.drive)
        compare = comparison_function(states, row)
        comparison = Comparison(
            **compare(values=at.values, since=since, track=followed, dt=dt, p=p)
        )
        factors = (-1, comparison.by_limit, comparison.by_asymmetry)
        across = ca.MX(len(states), 1)
        for part, factor in zip(SLOPED, factors):
            if slopes[part].nnz():
                across += factor * by[part]
        spread = sum(along(slopes[part], across) * by for part, by in zip(SLOPED, factors))
        variance = comparison.variance
        weight, root, shown = weights(states.context.robustness, row.trusted)(
            spread + variance, comparison.innovation, ROW.part(at.values, "mask"), comparison.counts
        )
        change = (weight * comparison.innovation) * across
        shares = states.gain_shares(row.drive, row.trusted, nominal)
        if kept.torques and not row.trusted:
            # parameters learn nothing from forces while something may touch the joints
            shares = {at: (1 - touched) * share for at, share in shares.items()}
        taken = ca.vertcat(*shares.values())
        if shares:
            change[list(shares)] *= taken
        if row.drive is not None:
            # a mean residual (friction declared) changes with the state; a remembered time does not
            declared = states.context.declares_friction(row.drive)
            kept.drives[row.drive]["friction"] = comparison.memory + (
                along(slopes["residual"], change) if declared else 0
            )
        if row.measured and row.name in kept.forces:
            # a force whose drive's position is lost tells nothing of torques
            position_is_read = 1 if row.drive is None else Tracks(tracks)[row.drive].lost == 0
            outputs = watch(
                kept=FORCE.joined(**kept.forces[row.name]),
                innovation=comparison.innovation,
                variance=spread + variance,
                is_used=share_used(ROW.part(at.values, "mask")) * position_is_read,
                dt=dt,
            )
            evidence[row.name] = outputs
            kept.forces[row.name] = {part: outputs[part] for part in FORCE.names}
        mean = mean + change
        covariance.take(root * across, list(shares), taken)
        innovations.append(shown)
        spreads.append(spread + variance)
    if kept.torques:
        # nor do other constants (biases, zeros) change while something touches a joint
        mean[fixed] += touched * (prior[fixed] - mean[fixed])
    open_torques(states, evidence, kept, mean, interval)
    measured = [k for k, at in enumerate(rows) if at.row.measured]
    y = ca.vertcat(*(innovations[k] for k in measured), *(spreads[k] for k in measured))
    return mean, covariance.matrix(), y


def comparison_function(states: StateVector, row: MeasurementRow) -> ca.Function:
    """Return the function (values, since, track, dt, p) → the parts of `Comparison` of one row.

    Args:
        row: whose `values` at the prior are in the layout `ROW`; `since` is in the layout `SINCE`,
            and `track` is of its drive, zeros where it has none.
    """
    context = states.context
    values = ca.SX.sym("values", ROW.size)
    since = ca.SX.sym("since", SINCE.size)
    track = ca.SX.sym("track", len(TRACKED))
    dt = ca.SX.sym("dt")
    prior = ROW.parts(values)
    change = SINCE.parts(since)
    residual, limit, asymmetry = (prior[part] + change[part] for part in SLOPED)
    if row.drive is None:
        comparison = Comparison(residual, prior["variance"], change["memory"])
    else:
        frictionless = Residual(
            value=residual,
            limit=ca.fmax(limit, 0),
            asymmetry=asymmetry,
            variance=prior["variance"],
            limit_variance=change["limit_variance"],
            value_variance=change["residual_variance"],
            memory=change["memory"],
            mask=prior["mask"],
        )
        comparison = compared(context, row.drive, Drive(*ca.vertsplit(track)), frictionless, dt)
    parts = {name: ca.densify(ca.SX(part)) for name, part in vars(comparison).items()}
    arguments = [values, since, track, dt, context.mechanism.parameters.symbols]
    names = ["values", "since", "track", "dt", "p"]
    return ca.Function("compare", arguments, ca.cse(list(parts.values())), names, list(parts))


def weights(robustness: Robustness, trusted: bool) -> ca.Function:
    """Return the function (S, ν, mask, counts) → (1/S' where the row is used, the root of that, the
    innovation to report), see `robust_variance`.

    A row that does not count (its drive is at a stop) reports NaN as its innovation.
    """
    spread, innovation, mask, counts = (ca.SX.sym(name) for name in ("S", "nu", "mask", "counts"))
    positive = ca.fmax(spread, SMALLEST_VARIANCE)
    robust = positive if trusted else robust_variance(robustness, positive, innovation)
    weight = share_used(mask) / robust
    shown = ca.if_else(ca.logic_and(is_there(mask), counts), innovation, np.nan)
    return ca.Function(
        "weights", [spread, innovation, mask, counts], [weight, ca.sqrt(weight), shown]
    )

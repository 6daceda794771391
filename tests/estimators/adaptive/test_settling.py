"""Samples that come slowly against the joints' own oscillation: between two of them the joints come
to rest.
"""

from __future__ import annotations

import json

import casadi as ca
import numpy as np
import pytest

from distal import Rig, estimate, load_rig
from distal.arrays import Floats
from distal.confidence import BAND
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.joint_motion import moving
from distal.model import Kick
from distal.rig import build_rig
from distal.run import samples_of
from tests.helpers import finite_difference, rms_degrees
from tests.support.drawn_rigs import settled
from tests.support.rough_plants import FITTED, described, log_of


def pair(**values: object) -> Rig:
    """Return a light link between two tendons, read twice a second, without friction or damping at
    the joint.
    """
    light: dict[str, object] = {
        "sensors.*.rate": 2.0,
        "joints.0.inertia": 1e-6,
        "joints.0.damping": 0.0,
        "joints.0.friction.coefficient": {"value": 0.0, "std": 0.0},
    }
    return load_rig("pulley-antagonist").with_values({**light, **values})


def step_of(rig: Rig, q: list[float], v: tuple[float, ...] = (0.0, 0.0, 0.0)) -> float:
    """Return the joint's angle after one long kick; assert that the slopes of its speed by places
    and by the torque are those of differences.
    """
    h = 0.5
    context = AdaptiveFilter(rig, False).states.context
    assert context.joints_settle
    mechanism, nj = context.mechanism, context.n_joints
    at, speed = ca.SX.sym("q", mechanism.n_bodies), ca.SX.sym("v", mechanism.n_bodies)
    torque = ca.SX.sym("tau", nj)
    effort = ca.vertcat(torque, ca.SX(mechanism.n_drives, 1))
    kick = Kick(at, speed, effort, ca.SX(h), ca.SX(h))
    made = moving(context, kick, torque, ca.SX.zeros(nj), [], [])
    p = mechanism.parameters
    outputs = [made.q[:nj], made.v[:nj], made.by_position, made.by_torque]
    step = ca.Function("step", [at, speed, torque, p.symbols], outputs)

    def found(q: Floats, pushed: Floats) -> list[Floats]:
        return [part.full() for part in step(q, v, pushed, p.values)]

    none = np.zeros(nj)
    angles, speeds, by_position, by_torque = found(q, none)
    np.testing.assert_allclose(angles[:, 0], q[:nj] + h * speeds[:, 0], rtol=1e-12)
    for slopes, numeric in (
        (by_position, finite_difference(lambda moved: found(moved, none)[1], q)),
        (by_torque, finite_difference(lambda pushed: found(q, pushed)[1], none)),
    ):
        least = 1e-5 * np.abs(slopes).max()
        np.testing.assert_allclose(slopes, numeric[:, : slopes.shape[1]], rtol=2e-4, atol=least)
    return float(angles[0, 0])


def test_a_joint_rests_where_its_tendons_balance() -> None:
    """Two alike tendons, drawn in by x1 and x2: θ = (x1 − x2)/2r, whatever the angle before; slopes
    by differences.
    """
    rig = pair()
    radius = rig.tendons[0].insertion.radius.value
    for start in (-0.2, 0.0, 0.15):
        angle = step_of(rig, [start, 6e-3, 4e-3], (30.0, 2e-3, -2e-3))
        # the drives are taken where they are at the end of the step; speeds before do not count
        assert angle == pytest.approx((7e-3 - 3e-3) / (2 * radius), abs=1e-4)


def test_a_spring_holds_against_the_tendons() -> None:
    """θ = r k (x1 − x2)/(2 k r² + k_s): all of it is linear, so one step ends there."""
    rig = pair(**{"joints.0.spring": {"stiffness": 0.1}})
    k, r = rig.tendons[0].stiffness.value, rig.tendons[0].insertion.radius.value
    assert step_of(rig, [0.05, 7e-3, 3e-3]) == pytest.approx(
        r * k * 4e-3 / (2 * k * r * r + 0.1), abs=1e-4
    )


def test_friction_holds_what_it_can() -> None:
    """Within its limit a joint stays where it was; beyond it comes as far as balance but for
    friction asks.
    """
    grip = {"coefficient": 0.3, "radius": 3e-3, "preload": 0.0}
    rig = pair(**{"joints.0.friction": grip})
    k, r = rig.tendons[0].stiffness.value, rig.tendons[0].insertion.radius.value
    assert step_of(rig, [0.0, 10e-3, 9.9e-3]) == 0.0
    moves = step_of(rig, [0.0, 12e-3, 8e-3])
    limit = 0.3 * 3e-3 * k * 20e-3
    # linear in one step: the limit is that of the tensions before
    assert moves == pytest.approx((r * k * 4e-3 - limit) / (2 * k * r * r), rel=1e-3)


def test_a_wrist_at_2_4_hz() -> None:
    """Three joints that turn one another, light as they are, without forces: friction alone leaves
    1 to 2°. The rig has its plant's own numbers.
    """
    raw = json.loads(json.dumps(settled(*described("stop and go", 0)), default=float))
    log = log_of("stop and go", 0, FITTED)
    log = log.select(slice(None, None, round(log.rate / 2.4)))
    rig = build_rig(raw, "wrist").with_values({"sensors.*.rate": log.rate})
    assert AdaptiveFilter(rig, False).substeps == 8
    result = estimate(log, rig, compiled=False)
    late = log.time > 0.2 * log.time[-1]  # it begins up to 10° away
    errors = (result.angles - result.truths)[late]
    assert rms_degrees(errors) < 2.5
    assert np.mean(np.abs(errors) < BAND * result.angle_stds[late]) >= 0.9


def test_a_motion_that_begins_between_slow_samples_is_no_wild_reading() -> None:
    """After a rest the mean speed tells nothing of 0.4 s: the drive is where its sensor says."""
    rig, log = build_rig(described("stop and go", 0)[0], "slow"), log_of("stop and go", 0, FITTED)
    estimator = AdaptiveFilter(rig, False)
    samples = samples_of(log, estimator.channels)
    belief = estimator.initial(log.time[0], samples[0])
    kernel_states = estimator.advanced(belief, log.time, samples).kernel_states
    still = np.diff(samples, axis=0, prepend=samples[:1])
    begins = np.abs(still[1:]) > 50 * np.abs(still[:-1]) + 0.05
    assert begins.sum() > 10
    np.testing.assert_allclose(kernel_states[:, list(estimator.positions)], samples, atol=1e-6)

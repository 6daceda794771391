"""Samples that come slowly against the joints' own oscillation: between two of them the joints come
to rest.
"""

from __future__ import annotations

import json

import casadi as ca
import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.joint_motion import moving
from distal.model import Kick
from distal.rig import build_rig
from tests.support.drawn_rigs import settled
from tests.support.rough_plants import FITTED, described, log_of

RATE = 2.0


def pair(**values: object) -> Rig:
    """Return a light link between two tendons, read twice a second, without friction or damping at
    the joint.
    """
    slow = {f"sensors.{name}.rate": RATE for name in ("x1", "u1", "x2", "u2")}
    light: dict[str, object] = {"joints.0.inertia": 1e-6, "joints.0.damping": 0.0}
    light["joints.0.friction.coefficient"] = {"value": 0.0, "std": 0.0}
    return load_rig("pulley-antagonist").with_values({**slow, **light, **values})


def step_of(
    rig: Rig, q: list[float], v: list[float], h: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the joints' angles after one long kick, and the slopes of their speeds by places and
    by the torque.
    """
    context = AdaptiveFilter(rig, False).states.context
    assert context.joints_settle
    mechanism, nj = context.mechanism, context.n_joints
    at, speed = ca.SX.sym("q", mechanism.n_bodies), ca.SX.sym("v", mechanism.n_bodies)
    torque, response = ca.SX.sym("tau", nj), ca.SX.zeros(mechanism.n_bodies, 4)
    effort = ca.vertcat(torque, ca.SX(mechanism.n_drives, 1))
    kick = Kick(at, speed, effort, response, ca.SX(h), ca.SX(h))
    made = moving(context, kick, torque, ca.SX.zeros(nj), [], [])
    p = mechanism.parameters
    found = ca.Function(
        "one",
        [at, speed, torque, p.symbols],
        [made.q[:nj], made.v[:nj], made.by_position, made.by_torque],
    )
    angles, speeds, *slopes = (np.array(part.full()) for part in found(q, v, [0.0] * nj, p.values))
    np.testing.assert_allclose(angles[:, 0], np.array(q[:nj]) + h * speeds[:, 0], rtol=1e-12)
    for k, slope in enumerate(slopes):
        for i in range(slope.shape[1]):
            ends = []
            for sign in (1, -1):
                moved, pushed = np.array(q), np.zeros(nj)
                (moved if k == 0 else pushed)[i] += sign * 1e-6
                ends.append(np.array(found(moved, v, pushed, p.values)[1].full())[:, 0])
            numeric = (ends[0] - ends[1]) / 2e-6
            np.testing.assert_allclose(
                slope[:, i], numeric, rtol=2e-4, atol=1e-5 * np.abs(slope).max()
            )
    return angles[:, 0], slopes


def test_a_joint_rests_where_its_tendons_balance() -> None:
    """Two alike tendons, drawn in by x1 and x2: θ = (x1 − x2)/2r, whatever the angle before; slopes
    by differences.
    """
    rig = pair()
    radius = rig.tendons[0].insertion.radius.value
    for start in (-0.2, 0.0, 0.15):
        angles, _ = step_of(rig, [start, 6e-3, 4e-3], [30.0, 2e-3, -2e-3], 0.5)
        # the drives are taken where they are at the end of the step; speeds before do not count
        assert angles[0] == pytest.approx((7e-3 - 3e-3) / (2 * radius), abs=1e-4)


def test_a_spring_holds_against_the_tendons() -> None:
    """θ = r k (x1 − x2)/(2 k r² + k_s): all of it is linear, so one step ends there."""
    rig = pair(**{"joints.0.spring": {"stiffness": 0.1}})
    k, r = rig.tendons[0].stiffness.value, rig.tendons[0].insertion.radius.value
    angles, _ = step_of(rig, [0.05, 7e-3, 3e-3], [0.0, 0.0, 0.0], 0.5)
    assert angles[0] == pytest.approx(r * k * 4e-3 / (2 * k * r * r + 0.1), abs=1e-4)


def test_friction_holds_what_it_can() -> None:
    """Within its limit a joint stays where it was; beyond it comes as far as balance but for
    friction asks.
    """
    grip = {"coefficient": 0.3, "radius": 3e-3, "preload": 0.0}
    rig = pair(**{"joints.0.friction": grip})
    k, r = rig.tendons[0].stiffness.value, rig.tendons[0].insertion.radius.value
    stays, _ = step_of(rig, [0.0, 10e-3, 9.9e-3], [0.0, 0.0, 0.0], 0.5)
    assert stays[0] == 0.0
    moves, _ = step_of(rig, [0.0, 12e-3, 8e-3], [0.0, 0.0, 0.0], 0.5)
    limit = 0.3 * 3e-3 * k * 20e-3
    # linear in one step: the limit is that of the tensions before
    assert moves[0] == pytest.approx((r * k * 4e-3 - limit) / (2 * k * r * r), rel=1e-3)


def known(kind: str, seed: int, rate: float) -> tuple[Rig, Log]:
    """Return a rig with its plant's own numbers, and a log of it of which only some samples are
    read.
    """
    raw = json.loads(json.dumps(settled(*described(kind, seed)), default=float))
    log = log_of(kind, seed, FITTED)
    every = max(1, round(1.0 / rate / (log.time[1] - log.time[0])))
    for sensor in raw["sensors"]:
        sensor["rate"] = 1.0 / (every * (log.time[1] - log.time[0]))
    return build_rig(raw, kind), log.select(slice(None, None, every))


def rms(rig: Rig, log: Log) -> tuple[float, float]:
    result = estimate(log, rig, compiled=False)
    errors = result.angles - np.column_stack(list(log.truth.values()))
    late = log.time > 0.2 * log.time[-1]  # it begins up to 10° away
    inside = np.abs(errors[late]) < 1.96 * result.angle_stds[late]
    return float(np.rad2deg(np.sqrt(np.mean(errors[late] ** 2)))), float(inside.mean())


def test_a_wrist_at_2_4_hz() -> None:
    """Three joints that turn one another, light as they are, without forces: friction alone leaves
    1 to 2°.
    """
    rig, log = known("stop and go", 0, 2.4)
    assert AdaptiveFilter(rig, False).substeps == 8
    error, inside = rms(rig, log)
    assert error < 2.5
    assert inside >= 0.9


@pytest.mark.slow
def test_slower_samples_tell_less_but_nothing_diverges() -> None:
    """Drives go in chords between two samples, which err by the square of the interval at most: so
    does the angle.
    """
    rates = (40.0, 10.0, 5.0, 2.0, 1.0)
    errors = [rms(*known("held", 1, rate))[0] for rate in rates]
    assert errors[0] < 0.3
    for k, rate in enumerate(rates[1:]):
        assert errors[k + 1] < (rates[k] / rate) ** 2 * errors[k]


def test_a_motion_that_begins_between_slow_samples_is_no_wild_reading() -> None:
    """After a rest the mean speed tells nothing of 0.4 s: the drive is where its sensor says."""
    rig, log = build_rig(described("stop and go", 0)[0], "slow"), log_of("stop and go", 0, FITTED)
    estimator = AdaptiveFilter(rig, False)
    samples = np.column_stack([log.channels[name] for name in estimator.channels])
    belief = estimator.initial(log.time[0], samples[0])
    rows, last = estimator.checked_rows(belief, log.time, samples)
    kernel_states = estimator.kernel.scan(belief.kernel_state, rows, estimator.parameters)[0][last]
    still = np.diff(samples, axis=0, prepend=samples[:1])
    begins = np.abs(still[1:]) > 50 * np.abs(still[:-1]) + 0.05
    assert begins.sum() > 10
    np.testing.assert_allclose(kernel_states[:, list(estimator.positions)], samples, atol=1e-6)

"""What may be wrong with a rig is tried in both directions: an arm that is too long, and one that
is too short.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from distal import Log, diagnose, estimate, load_rig, load_scenario, scenario_rig, simulate
from distal.confidence import BAND
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.channel_statistics import channel_statistics_of
from distal.diagnosis.comparison import stretch
from distal.diagnosis.explanations import _best_ratio
from distal.diagnosis.gears import out_of_reach
from distal.diagnosis.rerun import OUTLIER, ModelChange, Rerun
from distal.diagnosis.untested import _changes, _unseen, untestable
from distal.diagnosis.what_if import moved_by_starts, overconfidence, with_learned_parameters
from distal.estimators import AdaptiveFilter, StateKind
from distal.rig import build_rig
from distal.run.offline import estimator_for
from distal.simulation import Scenario
from tests.hand_rigs import hand


def test_each_scale_is_tried_with_its_inverse_and_each_zero_to_both_sides() -> None:
    scenario = load_scenario("series-2", ['duration="2 s"'])
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, 1)
    rerun = Rerun(log, estimator_for(log, rig, "adaptive", compiled=False))  # type: ignore[arg-type]
    tried: dict[tuple[str, tuple[str, ...], str], list[float]] = {}
    for group, drives, change in _changes(rerun):
        for kind, values in (
            ("channel", change.channels),
            ("number", change.parameters),
            ("added", change.added),
        ):
            for name, value in values.items():
                tried.setdefault((group, drives, f"{kind} {name}"), []).append(value)
    assert {group for group, _, _ in tried} == {
        texts.SCALE,
        texts.COMPLIANCE,
        texts.ZERO,
    }
    names = [drive.name for drive in rig.drives]
    assert {drives for _, drives, _ in tried} == {tuple(names), *((name,) for name in names)}
    for (group, _, what), values in tried.items():
        if group == texts.ZERO:
            span = np.ptp(log.channels[what.removeprefix("added ")])
            assert values == pytest.approx([0.1 * span, -0.1 * span], rel=1e-6)
        else:
            np.testing.assert_allclose(
                sorted(values), sorted(1 / value for value in values), rtol=0.01
            )
            assert what.startswith("number") or {-1.0, 57.3} < set(values)


class Stub:
    """A filter of one joint and two numbers whose angle is linear in where they begin, rerun with
    one of them changed.
    """

    def __init__(
        self, slopes: tuple[float, float], unlikely: float = 0.0, bounded: bool = True
    ) -> None:
        self.slopes, self.unlikely, self.bounded = slopes, unlikely, bounded
        states = SimpleNamespace(
            stds=np.array([0.0, 0.2, 0.5]), lasting=np.array([False, True, True])
        )
        kinds = (StateKind.ANGLE, StateKind.PARAMETER, StateKind.PARAMETER)
        rig = SimpleNamespace(joints=("joint",))
        self.estimator = SimpleNamespace(
            states=states,
            rig=rig,
            state_names=("theta", "one", "two"),
            state_kinds=kinds,
            parts=(),
            measured=("force",),
        )
        self.log = SimpleNamespace(time=np.arange(1000) / 100.0)
        self.base = self.outcome(0.0)

    def outcome(self, moved: float, squares: float = 1.0) -> Any:
        time = self.log.time
        means = np.zeros((len(time), 3))
        # in the first half second anything may be
        means[:, 0] = np.where(time < 0.5, 100.0 * moved, moved)
        variances = np.where(time < 0.5, 9.0, 0.04)[:, None] * np.ones((1, 3))
        likelihood = self.unlikely if moved else 0.0
        return SimpleNamespace(
            means=means,
            variances=variances,
            bounded=self.bounded,
            log_likelihood=likelihood,
            squares=squares * np.ones((len(time), 1)),
        )

    def each(self, changes: Iterable[ModelChange]) -> Iterator[Any]:
        for change in changes:
            ((name, shift),) = change.shifts.items()
            yield self.outcome(self.slopes[("one", "two").index(name)] * shift)


@pytest.mark.parametrize(("total", "said"), [(1.09, False), (1.11, True)])
def test_the_spread_over_starts_is_the_root_of_the_sum_of_squares(total: float, said: bool) -> None:
    """Two numbers, begun one std away, move the angle by 0.6 and 0.8 of `total` of its own stds,
    0.2.
    """
    found = overconfidence(cast(Any, Stub((0.6 * total * 0.2 / 0.2, 0.8 * total * 0.2 / 0.5))))
    assert bool(found) is said
    if said:
        assert found[0].text == texts.hangs_on_the_start("two", total, is_angle=False).text


class Counted(Rerun):
    """Counts its runs."""

    runs = 0

    def each(self, changes: Iterable[ModelChange]) -> Iterator[Any]:
        changes = list(changes)
        self.runs += len(changes)
        return super().each(changes)


def test_parts_that_do_not_touch_are_shifted_in_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """It gives what one run for each shift gives, with fewer of them."""
    rig = hand(["finger-underactuated", "capstan-joint"], {"sensors.*.rate": 200.0})
    pulled = {"torque": [["0 s", "10 mN m"], ["1 s", "60 mN m"]]}
    drives = {drive.name: pulled for drive in rig.drives}
    log = simulate(rig, Scenario(rig="hand", name="hand", duration=1.0, drives=drives), 5)
    together = Counted(log, AdaptiveFilter(rig))
    found = moved_by_starts(together)
    monkeypatch.setattr(AdaptiveFilter, "parts", ())
    alone = Counted(log, AdaptiveFilter(rig))
    expected = moved_by_starts(alone)
    assert together.runs < 0.8 * alone.runs
    assert found.keys() == expected.keys()
    for name, moved in found.items():
        np.testing.assert_allclose(moved, expected[name], rtol=1e-6, atol=1e-12)
    assert [finding.text for finding in untestable(together)] == [
        finding.text for finding in untestable(alone)
    ]


def test_a_start_that_the_log_rejects_counts_by_its_likelihood() -> None:
    """Half as likely, it has half the weight in the sum of squares; one that leaves all bounds has
    none.
    """
    assert overconfidence(cast(Any, Stub((0.0, 1.5 * 0.2 / 0.5), np.log(0.5)))) == []
    (found,) = overconfidence(cast(Any, Stub((0.0, 1.6 * 0.2 / 0.5), np.log(0.5))))
    assert found.text == texts.hangs_on_the_start("two", 1.6 / np.sqrt(2.0), is_angle=False).text
    assert overconfidence(cast(Any, Stub((0.0, 1.6 * 0.2 / 0.5), np.log(2.0))))[0].text == (
        texts.hangs_on_the_start(
            "two", 1.6, is_angle=False
        ).text  # more likely than it was: it counts once
    )
    assert overconfidence(cast(Any, Stub((0.0, 9.0), bounded=False))) == []


@pytest.mark.parametrize(
    ("moved", "against", "unseen"),
    [(1.1, (), True), (0.9, (), False), (-1.1, ("old",), True), (1.1, ("new",), False)],
)
def test_a_change_is_unseen_that_moves_the_angle_and_contradicts_nothing_new(
    moved: float, against: tuple[str, ...], unseen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By more than half of 1.96 stds of the angle, as they are then, in more than a tenth of the
    samples.
    """
    found = {("disagrees", subject) for subject in against}
    monkeypatch.setattr("distal.diagnosis.untested.contradictions", lambda rerun, outcome: found)
    stub = Stub((0.0, 0.0))
    outcome = stub.outcome(1.0)
    far = moved / 2.0 * 1.96 * np.sqrt(stub.base.variances[:, 0])
    outcome.means[:, 0] = np.where(np.arange(1000) % 9, 0.0, far)  # in 11 % of the samples
    of_base: Any = {("disagrees", "old")}
    assert _unseen(cast(Any, stub), outcome, of_base) is unseen
    outcome.squares[:600] = np.nan  # less than half of it is still compared
    assert not _unseen(cast(Any, stub), outcome, of_base)
    outcome.bounded = False
    assert not _unseen(cast(Any, stub), outcome, of_base)


def test_the_ratio_of_a_gear_is_searched_between_those_that_are_tried() -> None:
    """Angle over 37, torque times 37, a likelihood that falls with the distance from that: found to
    a few parts in 1000.
    """
    for true in (37.0, 1 / 37.0, 3.3):

        def rerun(change: ModelChange, true: float = true) -> Any:
            ratio = change.channels["torque"]
            assert change.channels["angle"] == pytest.approx(1 / ratio)
            return SimpleNamespace(
                innovations=np.ones(10),
                bounded=True,
                log_likelihood=-10 * abs(np.log(ratio / true)),
            )

        stub = SimpleNamespace(each=partial(map, rerun))
        assert _best_ratio(cast(Any, stub), {"angle": -1, "torque": 1}) == pytest.approx(
            true, rel=0.01
        )


def test_what_a_kinematic_estimate_may_miss_is_the_stretch_by_friction_and_unknown_stiffness() -> (
    None
):
    """(2 f + |F − F_0| b)/(k (1 − b) r), b the 95 % of the stiffness, typed out for a slider's
    tendon.
    """
    rig = load_rig("paper-2008-observed").with_values(
        {
            "tendons.*.stiffness": {"value": 800.0, "std": 40.0},
            "drives.*.friction.constant": {"value": 0.05, "std": 0.01},
            "drives.*.friction.load": {"value": 0.02, "std": 0.005},
            "drives.*.hysteresis": {
                "constant": {"value": 0.3, "std": 0.1},
                "load": {"value": 0.01, "std": 0.0},
            },
            "tendons.*.path": {
                "friction": {"value": 0.1, "std": 0.02},
                "wrap": {"value": 1.5, "std": 0.0},
            },
        }
    )
    sensor = next(s for s in rig.sensors_of("force") if s.of == rig.drives[0].name)
    others = {s.name: np.full(4, 2.0) for s in rig.sensors_of("force")}
    read = np.array([np.nan, 3.0, 1.0, 7.0])
    log = Log(np.arange(4) / 10.0, {**others, sensor.name: read})
    arm = next(iter(rig.tendons[0].arms().values()))

    def of(values: np.ndarray, name: str) -> np.ndarray:
        tension = np.nanmax(np.abs(values)) + rig.tendons[0].pretension.value
        high = {
            "load": 0.02 + BAND * 0.005,
            "constant": 0.3 + BAND * 0.1,
            "path": (0.1 + BAND * 0.02) * 1.5,
        }
        friction = (
            0.05
            + BAND * 0.01
            + high["load"] * tension
            + high["constant"]
            + 0.01 * tension
            + tension * np.expm1(high["path"])
        )
        pull = np.abs(np.nan_to_num(values - values[np.isfinite(values)][0]))
        noise = next(s for s in rig.sensors_of("force") if s.name == name).noise
        b = BAND * rig.tendons[0].stiffness.total_std / 800.0
        return (2 * friction + 2 * BAND * noise + b * pull) / (800.0 * (1 - b)) / abs(arm)

    expected = np.mean([of(log.channels[s.name], s.name) for s in rig.sensors_of("force")], axis=0)
    np.testing.assert_allclose(stretch(log, rig, rig.joints[0].name), expected, rtol=1e-9)


def test_without_forces_the_stretch_is_that_of_what_the_nominal_force_may_be() -> None:
    """Two tendons on a capstan share it: 2 · 1.96 σ_τ/R + 2 h over two springs, its band at most 80
    % of the stiffness.
    """
    rig = load_rig("capstan-joint").with_values(
        {
            "drives.0.nominal_force": {"value": 0.0, "std": 0.03},
            "drives.0.hysteresis": {
                "constant": {"value": 0.02, "std": 0.0},
                "load": {"value": 0.1, "std": 0.0},
            },
            "tendons.*.stiffness": {"value": 2e4, "std": 1e4},
        }
    )
    radius, tension = rig.drives[0].radius.value, rig.tendons[0].pretension.value  # type: ignore[union-attr]
    arm = next(iter(rig.tendons[0].arms().values()))
    force = 2 * BAND * rig.drives[0].nominal_force.total_std / radius + 2 * (
        0.02 / radius + 0.1 * tension
    )
    log = Log(np.arange(3) / 10.0, {"motor_angle": np.zeros(3)})
    np.testing.assert_allclose(
        stretch(log, rig, "jaw"), force / (0.2 * 2e4 * 2) / abs(arm), rtol=1e-9
    )


def test_a_rerun_is_a_run_of_the_changed_log() -> None:
    """A channel that is doubled, and a number of the rig that is taken times 1.1, as if log and rig
    had been so.
    """
    scenario = load_scenario("series-2", ['duration="0.5 s"'])
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, 1)
    rerun = Rerun(log, cast(Any, estimator_for(log, rig, "adaptive", compiled=False)))
    doubled = replace(log, channels={**log.channels, "u1": 2.0 * log.channels["u1"]})
    expected = Rerun(
        doubled, cast(Any, estimator_for(doubled, rig, "adaptive", compiled=False))
    ).base
    found = rerun(ModelChange(channels={"u1": 2.0}))
    np.testing.assert_allclose(found.means, expected.means, rtol=1e-9, atol=1e-12)
    shifted = replace(log, channels={**log.channels, "x1": log.channels["x1"] + 1e-3})
    off = Rerun(shifted, cast(Any, estimator_for(shifted, rig, "adaptive", compiled=False))).base
    np.testing.assert_allclose(
        rerun(ModelChange(added={"x1": 1e-3})).means, off.means, rtol=1e-9, atol=1e-12
    )
    name = rerun.estimator.state_names[-1]
    moved = rerun(ModelChange(shifts={name: 1e-3}))
    assert not np.array_equal(moved.means, rerun.base.means)
    # ln p typed out, an outlier beyond 9 S counting as in the filter
    compared = [
        (v, s)
        for v, s in zip(found.innovations.ravel(), found.innovation_variances.ravel())
        if np.isfinite(v)
    ]
    inflated = [(v, s * max(1.0, v**2 / s / OUTLIER)) for v, s in compared]
    assert found.log_likelihood == pytest.approx(
        -0.5 * sum(v**2 / s + np.log(s) for v, s in inflated)
    )


def test_how_far_a_joint_would_turn_is_over_its_stops_or_what_any_turns() -> None:
    """What the motor's angle is worth at the joint, R/r of it, over 40° between its stops, or over
    270°.
    """
    log = Log(np.arange(3) / 10.0, {"motor_angle": np.array([0.0, 30.0, 10.0])})
    rig = load_rig("capstan-joint")
    turned = 30.0 * rig.drives[0].radius.value / rig.tendons[0].total_arm  # type: ignore[union-attr]
    for stops, room in ((["-15 deg", "25 deg"], np.deg2rad(40.0)), (None, np.deg2rad(270.0))):
        raw = rig.model_dump()
        raw["joints"][0]["stops"] = None
        each = (
            build_rig(raw, "rig") if stops is None else rig.with_values({"joints.0.stops": stops})
        )
        (finding,) = out_of_reach(log, each)
        assert finding.text == texts.looks_geared_at_least("motor_angle", turned / room).text
    assert out_of_reach(Log(log.time, {"motor_angle": np.array([0.0, 1.0, 0.5])}), rig) == []


@pytest.mark.parametrize(("friction", "consistent"), [(0.05, True), (0.15, False)])
def test_what_a_log_teaches_within_its_std_contradicts_nothing(
    friction: float, consistent: bool
) -> None:
    """A motor's friction of 0.05 for 0.02 +- 50 %: the first innovations drift, none does once it
    is known.
    """
    plan = load_scenario("lab-bench")
    rig = scenario_rig(plan)
    plant = rig.with_values({"drives.0.friction.constant": friction})
    log = simulate(plant, plan.model_copy(update={"plant": {}, "duration": 12.0}), 1)
    result = estimate(log, rig)
    assert channel_statistics_of(result).findings()[0].contradicts
    again = channel_statistics_of(
        with_learned_parameters(result, Rerun(log, estimator_for(log, rig, "adaptive")))
    )  # type: ignore[arg-type]
    assert (not any(finding.contradicts for finding in again.findings())) is consistent
    assert diagnose(result, log, rig).consistent is consistent

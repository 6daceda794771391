"""What a known truth says of a wrong rig: the cause is named, with its size, on logs that are
written without the model.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.ladder import log_of as log_of_plant

from distal import Log, Rig, diagnose, estimate, load_rig, read_log, simulate
from distal.arrays import Floats
from distal.diagnosis import why_diverged
from distal.diagnosis.against_truth import _likeliest, against_truth, causes
from distal.diagnosis.of_estimate import diagnose_estimate
from distal.diagnosis.rerun import ModelChange, Outcome
from distal.diagnosis.trials import _of_frictions
from distal.estimators import AdaptiveFilter
from distal.results import Estimate
from distal.simulation import load_scenario

ARMS = np.array([[8e-3, 0.0], [-8e-3, 0.0], [7e-3, 6e-3], [-7e-3, -6e-3]])
"""Moment arms of finger-2n: tendons by joints [m]."""

DRIVES, STIFFNESS = ("mcp_f", "mcp_e", "pip_f", "pip_e"), 2500.0
ERROR = np.deg2rad(5.0)


@pytest.fixture(scope="module")
def finger() -> Rig:
    return load_rig("finger-2n")


def log_of(
    arms: Floats = ARMS,
    stiffness: float = STIFFNESS,
    delay: float = 0.0,
    scale: float = 1.0,
    zero: float = 0.0,
) -> Log:
    """Return places s = A θ + F/k of both joints in motion, the first drive's otherwise scaled,
    late, or off.
    """
    time = np.arange(0.0, 12.0, 0.01)

    def positions(at: Floats) -> tuple[Floats, Floats, Floats]:
        angles = np.column_stack([0.5 * np.sin(1.3 * at), 0.4 + 0.4 * np.sin(0.7 * at + 1)])
        forces = np.column_stack([3 + np.sin(2.1 * at + k) for k in range(4)])
        return angles, forces, angles @ arms.T + forces / np.array([stiffness, *[STIFFNESS] * 3])

    angles, forces, at_time = positions(time)
    late = scale * positions(time - delay)[2][:, 0] + zero
    channels = {f"x_{name}": late if k == 0 else at_time[:, k] for k, name in enumerate(DRIVES)}
    channels |= {f"F_{name}": forces[:, k] for k, name in enumerate(DRIVES)}
    return Log(time, channels, {"theta_mcp": angles[:, 0], "theta_pip": angles[:, 1]})


def turned(joint: int, factor: float) -> Floats:
    arms = ARMS.copy()
    arms[2, joint] *= factor
    return arms


@pytest.mark.parametrize(
    ("log", "words"),
    [
        (log_of(scale=1.5), "x_mcp_f looks 1.5 times too large: unit or moment arm"),
        (log_of(scale=0.67), "x_mcp_f looks 0.67 times too large: unit or moment arm"),
        (log_of(scale=-1.0), "x_mcp_f looks as if its sign, or the side of its tendon, were wrong"),
        (
            log_of(scale=-2.0),
            "x_mcp_f looks as if its sign, or the side of its tendon, were wrong (and 2 times too "
            "large)",
        ),
        (log_of(scale=1000.0), "x_mcp_f looks like millimetres"),
        (log_of(zero=2e-3), "x_mcp_f looks 2 mm off: its zero, or the pre-tension"),
        (
            log_of(arms=turned(1, 1.5)),
            "pip_f at pip looks as if its moment arm were 1.5 times the rig's",
        ),
        (
            log_of(arms=turned(0, 0.5)),
            "pip_f at mcp looks as if its moment arm were 0.5 times the rig's",
        ),
        (
            log_of(arms=turned(1, -1.0)),
            "pip_f at pip looks as if its moment arm were -1 times the rig's (wrong side)",
        ),
        (
            log_of(stiffness=STIFFNESS / 2),
            "F_mcp_f looks as if it stretched the tendons of mcp_f 2 times as far: their "
            "stiffness, its scale, or friction "
            "in it",
        ),
    ],
)
def test_the_cause_is_named_with_its_size(finger: Rig, log: Log, words: str) -> None:
    """Each is the only thing that is wrong, so that least squares finds it exactly."""
    small = ERROR / 20 if "stretched" in words else ERROR
    assert causes(log, finger, small)[0].text == words


@pytest.mark.parametrize("delay", [0.1, -0.1])
def test_a_delay_is_named_but_for_its_curvature(finger: Rig, delay: float) -> None:
    """s(t − τ) is s − τ ds/dt to second order: ω τ/2 of it is 7 % at 1.3 rad/s."""
    words = causes(log_of(delay=delay), finger, ERROR / 5)[0].text.split()
    assert words[:2] == ["x_mcp_f", "looks"]
    assert float(words[2]) == pytest.approx(0.1, rel=0.07)
    assert words[4] == ("late" if delay > 0 else "early")


def test_two_drives_with_one_cause_are_one_line(finger: Rig) -> None:
    log = log_of()
    doubled = {
        name: (2 * values if name in ("x_mcp_f", "x_mcp_e") else values)
        for name, values in log.channels.items()
    }
    found = causes(replace(log, channels=doubled), finger, ERROR)
    subjects, _, words = found[0].text.partition(" look ")
    assert set(subjects.split(" and ")) == {"x_mcp_f", "x_mcp_e"}
    assert words == "2 times too large: unit or moment arm"


@pytest.mark.parametrize("kind", ["position", "force"])
def test_two_columns_that_are_exchanged_are_named(seen: Log, finger: Rig, kind: str) -> None:
    first, second = finger.sensors_of(kind)[:2]
    channels = dict(seen.channels)
    channels[first.name], channels[second.name] = channels[second.name], channels[first.name]
    found = causes(replace(seen, channels=channels), finger, ERROR)
    assert any(
        finding.text == f"{first.name} and {second.name} look swapped" for finding in found[:2]
    )


def test_zeros_that_cancel_are_not_named_for_what_the_rig_allows(seen: Log, finger: Rig) -> None:
    """Of a zero and a stiffness that explain the same the one nearer to the rig's stds comes
    first.
    """
    soft = finger.with_values({"tendons.mcp_f.stiffness": 2.0 * finger.tendons[0].stiffness.value})
    found = causes(seen, soft, ERROR)
    assert found
    assert finger.tendons[0].name == "mcp_f"
    assert "mcp_f" in found[0].text


def test_a_rig_that_is_right_has_no_cause(finger: Rig) -> None:
    assert causes(log_of(), finger, np.deg2rad(0.1)) == []


def test_without_a_truth_or_motion_nothing_is_said(finger: Rig) -> None:
    log = log_of(scale=2.0)
    assert causes(replace(log, truth={}), finger, ERROR) == []
    still = replace(log, truth={name: np.zeros(len(log)) for name in log.truth})
    assert causes(still, finger, ERROR) == []


@pytest.fixture(scope="module")
def seen() -> Log:
    scenario = load_scenario("finger", ['duration="6 s"'])
    return simulate("finger-2n", scenario, 5)


@pytest.mark.parametrize("factor", [0.67, 1.5])
def test_the_last_word_is_the_truths(seen: Log, finger: Rig, factor: float) -> None:
    """A log of the rig itself, its first place scaled: never "consistent", and the scale is named
    to 3 %.
    """
    wrong = replace(seen, channels={**seen.channels, "x_mcp_f": factor * seen.channels["x_mcp_f"]})
    result = estimate(wrong, finger, compiled=False)
    said = diagnose(result, wrong, finger, what_if=False, compiled=False)
    assert not said.consistent
    assert said.text.startswith("the truth contradicts: ")
    looks = next(finding for finding in said.findings if finding.kind == "looks like")
    assert looks.subject == "x_mcp_f"
    assert float(looks.text.split(" times")[0].split()[-1]) == pytest.approx(factor, rel=0.03)


def test_a_band_that_holds_the_truth_is_believed(seen: Log, finger: Rig) -> None:
    assert against_truth(estimate(seen, finger, compiled=False), seen, finger) == []


def test_an_arm_beyond_its_stds_is_named_inside_a_wide_band_too(finger: Rig) -> None:
    """Of `beyond` only scales and arms that are more than three of their stds off: 1.15 % is taken
    as 3 %.
    """
    far, near = (
        causes(log_of(arms=turned(1, factor)), finger, ERROR / 10, beyond=True)
        for factor in (1.15, 1.06)
    )
    assert [finding.subject for finding in far] == ["pip_f at pip"]
    assert near == []


def test_why_a_run_left_all_bounds_is_said(seen: Log, finger: Rig) -> None:
    """Millimetres for metres, by the truth; without one by running the filter with what is
    tried.
    """
    wrong = replace(seen, channels={**seen.channels, "x_mcp_f": 1000 * seen.channels["x_mcp_f"]})
    assert why_diverged(wrong, finger, compiled=False)[0].text == "x_mcp_f looks like millimetres"
    rig = load_rig("paper-2008")
    log = simulate(rig, load_scenario("series-2", ['duration="4 s"']), 1)
    again = replace(log, channels={**log.channels, "x1": 1000 * log.channels["x1"]}, truth={})
    assert "x1" in {finding.subject for finding in why_diverged(again, rig, compiled=False)}


def test_a_pull_stretches_from_pre_tension_on(finger: Rig) -> None:
    """s = A θ + (F − F_0)/k: with the pre-tension in the rig file that was in the log, nothing is
    off.
    """
    tense, log = finger.with_values({f"tendons.{k}.pretension": 5.0 for k in range(4)}), log_of()
    shifted = {
        name: values - 5.0 / STIFFNESS * name.startswith("x_")
        for name, values in log.channels.items()
    }
    assert causes(replace(log, channels=shifted), tense, np.deg2rad(0.1)) == []
    assert "look 2 mm off: its zero, or the pre-tension" in causes(log, tense, ERROR)[0].text


@pytest.mark.parametrize(
    ("joints", "outside", "contradicts"),
    [([0, 1], 0.12, False), ([0, 1], 0.18, True), ([1], 0.28, False), ([1], 0.32, True)],
)
def test_the_truth_contradicts_where_less_than_85_percent_are_inside(
    seen: Log, finger: Rig, joints: list[int], outside: float, contradicts: bool
) -> None:
    """Of all joints together; of one alone, less than 70 %."""
    result = estimate(seen, finger, compiled=False)
    truths = np.array(result.angles)
    for joint in joints:
        within = slice(
            round((outside + 0.01 * joint) * len(truths))
        )  # the second one is a little worse
        truths[within, joint] += 10 * result.angle_stds[within, joint]
    said = [
        one
        for one in against_truth(replace(result, truths=truths), seen, finger)
        if one.kind == "against the truth"
    ]
    assert [one.subject for one in said] == (["pip"] if contradicts else [])
    if contradicts:
        assert said[0].text.endswith(f"{100 * (0.99 - outside):.0f} % inside the band")


def errors_of(result: Estimate, share: float) -> Estimate:
    """Return the result with a truth that is off by a share of the band's median half-width,
    everywhere.
    """
    offset = share * 1.96 * np.median(result.angle_stds, axis=0)
    return replace(
        result, truths=np.array(result.angles) + np.minimum(offset, 1.9 * result.angle_stds)
    )


@pytest.mark.parametrize(("share", "is_said"), [(0.25, False), (0.4, True)])
def test_an_error_that_the_band_allows_is_not_called_consistent(
    seen: Log, finger: Rig, share: float, is_said: bool
) -> None:
    """Above 0.3 of the half-width: said first, without contradiction, and what is said of the
    innovations stays.
    """
    result = errors_of(estimate(seen, finger, compiled=False), share)
    found = against_truth(result, seen, finger)
    assert [finding.kind for finding in found][:1] == (["errs inside"] if is_said else [])
    assert not any(finding.contradicts for finding in found)
    said = diagnose_estimate(result, found[:1])
    assert said.consistent
    assert said.text.startswith(
        "the band holds the truth (100 %), but " if is_said else "consistent: "
    )
    assert "agree with the rig" in said.text


class Halved:
    """A filter over a log that errs by half as much, or by a third, where one channel is scaled."""

    def __init__(self, log: Log, rig: Rig, channel: str, left: float) -> None:
        self.log, self.estimator = log, AdaptiveFilter(rig, compiled=False)
        self._channel, self._left, self.base = channel, left, self.means(1.0)

    def means(self, share: float) -> Outcome:
        truths = np.column_stack([self.log.truth[f"theta_{name}"] for name in ("mcp", "pip")])
        means = truths + share * ERROR
        variances = np.full(means.shape, np.deg2rad(0.1) ** 2)
        return Outcome(means, variances, *(np.zeros((0, 0)) for _ in range(2)), bounded=True)

    def each(self, changes: Iterable[ModelChange]) -> Iterator[Outcome]:
        for change in changes:
            yield self.means(self._left if self._channel in change.channels else 1.0)


@pytest.mark.parametrize(
    ("channel", "left", "named"),
    [("F_mcp_f", 0.4, True), ("F_mcp_f", 0.6, False), ("u", 0.1, False)],
)
def test_a_cause_inside_the_band_is_named_where_the_filter_is_right_without_it(
    seen: Log, finger: Rig, channel: str, left: float, named: bool
) -> None:
    log = log_of(stiffness=STIFFNESS / 2)
    result = errors_of(estimate(seen, finger, compiled=False), 0.45)
    rerun = Halved(log, finger, channel, left)
    found = against_truth(result, log, finger, lambda: rerun)  # type: ignore[arg-type, return-value]
    assert [finding.subject for finding in found[1:]] == (["F_mcp_f"] if named else [])


def test_what_would_explain_an_error_inside_the_band_is_named(seen: Log, finger: Rig) -> None:
    """A tendon half as stiff as in the rig, beside an estimate whose band holds the truth."""
    log = log_of(stiffness=STIFFNESS / 2)
    result = errors_of(estimate(seen, finger, compiled=False), 0.45)
    assert len(against_truth(result, log, finger)) == 1
    inside, *explained = against_truth(
        result, log, finger, lambda: Halved(log, finger, "F_mcp_f", 0.1)
    )  # type: ignore[arg-type, return-value]
    assert inside.kind == "errs inside"
    assert {finding.kind for finding in explained} == {"would explain"}
    assert explained[0].subject == "F_mcp_f"
    said = diagnose_estimate(result, [inside, *explained])
    assert f"{inside.text}: {explained[0].text}" in said.text


def test_a_gear_is_not_taken_for_a_force_of_the_wrong_sign(data: Path, tmp_path: Path) -> None:
    """A pull that rises with the angle goes with it as a gear does; the filter without the gear
    errs less than without the sign.
    """
    rig = load_rig(data / "newcomer" / "joint.toml", ["sensors.encoder.gear=33"])
    log = read_log(log_of_plant("joint", 5006, tmp_path), rig)
    looks = [
        one for one in diagnose(estimate(log, rig), log, rig).findings if one.kind == "looks like"
    ]
    assert looks[0].subject == "encoder"
    assert not any("sign" in one.text for one in looks)


def test_a_truth_of_one_joint_of_a_chain_is_enough_for_its_own_drives(finger: Rig) -> None:
    """Those of mcp pull at it alone; those of pip cross both joints, of which one is not known."""
    log = log_of(scale=1.5)
    half = replace(log, truth={**log.truth, "theta_pip": np.full(len(log), np.nan)})
    assert [finding.text for finding in causes(half, finger, ERROR)] == [
        "x_mcp_f looks 1.5 times too large: unit or moment arm"
    ]


def test_a_cause_says_what_takes_it_off(finger: Rig) -> None:
    """A place twice too large is halved, or its radius doubled; a tendon that stretches half as far
    is twice as stiff.
    """
    doubled = log_of(scale=2.0)
    (scale,) = _likeliest(doubled, finger, ERROR)[:1]
    by_reading, by_number = scale.undone
    assert by_reading.channels == {"x_mcp_f": pytest.approx(0.5)}
    assert by_number.parameters == {"tendons.0.crossings.0.radius": pytest.approx(2.0)}
    soft = log_of(stiffness=STIFFNESS / 2)
    force = next(one for one in _likeliest(soft, finger, ERROR) if one.subject == "F_mcp_f")
    by_reading, by_number = force.undone
    assert by_reading.channels == {"F_mcp_f": pytest.approx(2.0, rel=0.05)}
    assert by_number.parameters == {"tendons.0.stiffness": pytest.approx(0.5, rel=0.05)}
    (arm,) = (
        one for one in _likeliest(log_of(arms=turned(1, 1.3)), finger, ERROR) if one.kind == "arm"
    )
    assert [*arm.undone[0].parameters.values()] == [pytest.approx(1.3, rel=0.05)]
    assert all(
        path.startswith("tendons.") and path.endswith(".radius")
        for path in arm.undone[0].parameters
    )


@pytest.mark.parametrize("channel", ["x_mcp_f", "x_mcp_e", "x_pip_e"])
def test_without_a_truth_a_wrong_sign_comes_before_units_that_make_a_force_small(
    channel: str,
) -> None:
    """A force read as if in other units is near zero, and agrees with much: the sign contradicts
    nothing either.
    """
    scenario = load_scenario("finger").model_copy(update={"plant": {}})
    rig = load_rig("finger-2n")
    seen = simulate(rig, scenario, 5)
    turned = replace(seen, channels={**seen.channels, channel: -seen.channels[channel]}, truth={})
    assert why_diverged(turned, rig)[0].text.startswith(
        f"{channel} looks as if its sign were wrong"
    )


def test_friction_is_a_cause(seen: Log, finger: Rig) -> None:
    """A joint's friction three times what the plant has is named with its size."""
    path = "joints.0.friction.coefficient"
    rubs = finger.with_values({path: 3.0 * finger.joints[0].friction.coefficient.value})
    said = diagnose(estimate(seen, rubs), seen, rubs)
    looks = next(one for one in said.findings if one.kind in ("looks like", "would explain"))
    assert looks.subject == "friction of mcp"
    assert float(looks.text.split(" times")[0].split()[-1]) == pytest.approx(1 / 3, rel=0.4)


def test_two_things_that_are_wrong_are_both_named(seen: Log, finger: Rig) -> None:
    """The second is found beside the first."""
    scaled = {"x_mcp_f": 1.5 * seen.channels["x_mcp_f"], "x_pip_e": 1.5 * seen.channels["x_pip_e"]}
    wrong = replace(seen, channels={**seen.channels, **scaled})
    said = diagnose(estimate(wrong, finger), wrong, finger)
    text = " ".join(one.text for one in said.findings if one.kind == "looks like")
    assert "x_mcp_f" in text
    assert "pip_e" in text


@pytest.mark.parametrize(
    ("changed", "left"),
    [
        ({"joints.jaw.friction": None}, {"friction of motor"}),
        (
            {"drives.motor.friction.constant": 0.0, "drives.motor.friction.load": 0.0},
            {"friction of jaw"},
        ),
        ({}, {"friction of jaw", "friction of motor"}),
    ],
)
def test_friction_that_a_rig_lacks_is_not_tried(changed: dict[str, object], left: set[str]) -> None:
    """A joint's axle may have none at all; a drive's is zero then."""
    rig = load_rig("capstan-joint").with_values(changed)
    tried = _of_frictions(AdaptiveFilter(rig, compiled=False))
    assert {trial.cause.subject for trial in tried} == left

"""What positions say of forces: good logs are ok, wrong readings and touches are not, and where no
log has been it is said."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from distal import LiveEstimator, Log, Monitor, Rig, diagnose, estimate, load_rig, log_health
from distal.errors import RigError
from distal.fitting.fit import write_fitted
from distal.fitting.learned_maps import efforts_of
from distal.kernels import Feed, advance
from distal.regression import (
    INDEPENDENT,
    MOST,
    begun_by,
    features_along,
    forces_function,
    forces_parameters,
    whitening,
)
from distal.regression.features import Shape
from distal.run import JointContact, samples_of
from distal.run.exchanged_or_late import (
    AVERAGED,
    KEPT,
    LATE,
    LATER,
    PRIOR,
    Redundancy,
    _kernel,
    unlike_free_motion,
)
from distal.run.health import Health, Watch
from tests.helpers import changed
from tests.support.foreign_plants import finger_log, finger_rig
from tests.support.hands_plants import ropes_log, ropes_rig

LOGS = [finger_log(seed, 20.0) for seed in range(4)]


@pytest.fixture(scope="module")
def rig() -> Rig:
    bare = finger_rig().bare()
    return bare.with_map(efforts=efforts_of(LOGS, bare, range(4)))


def share(words: Sequence[str], *named: str) -> float:
    return float(np.mean([word in named for word in words]))


@pytest.mark.parametrize("seed", [11, pytest.param(12, marks=pytest.mark.more)])
def test_in_a_good_log_nothing_is_touched(rig: Rig, seed: int) -> None:
    """The rest is as without maps: the filter of this rig, which lacks the sheath, disagrees."""
    log = finger_log(seed, 20.0)
    words = log_health(log, rig)
    assert share(words, "touched") < 0.003
    good = [word for word, old in zip(words, log_health(log, rig.bare())) if old == "ok"]
    assert {*good} <= {"ok", "outside"}


def test_a_log_that_begins_and_stays_at_rest_is_not_touched(rig: Rig) -> None:
    """Nobody knows from which side a drive came there."""
    for log in LOGS[:3]:
        for row in (300, 900, 1500):
            held = {name: np.full(1500, column[row]) for name, column in log.channels.items()}
            held["motor_torque"] += np.random.default_rng(row).normal(0.0, 2e-3, 1500)
            rest = replace(log, time=log.time[:1500], channels=held, truth={})
            assert share(log_health(rest, rig), "touched", "dead") == 0.0, row


def test_of_what_logs_taught_the_end_of_a_range_is_no_news(rig: Rig) -> None:
    """They say where a position may be; without them a motor beyond its range has slipped."""
    with_stops = rig.with_values({"joints.finger.stops": ["-5 deg", "100 deg"]})
    for described, count in ((with_stops, 0), (with_stops.bare(), 1)):
        assert len(Watch(LiveEstimator(described).estimator).ends) == count


def test_of_what_logs_taught_a_repetition_is_no_fault(rig: Rig) -> None:
    """A motor at rest may repeat its position, although the rig says that it has noise."""
    noisy = rig.with_values({"sensors.motor_angle.noise": 1e-2})
    log = finger_log(11, 20.0)
    held = {name: values[:300] for name, values in log.channels.items()}
    held["motor_angle"] = np.full(300, log.channels["motor_angle"][900])
    rest = replace(log, time=log.time[:300], channels=held, truth={})
    assert "dead" not in log_health(rest, noisy)
    assert log_health(rest, noisy.bare())[-1] == "dead"


def test_of_what_logs_taught_a_touch_is_what_its_forces_say(rig: Rig) -> None:
    """The filter's own touches are said only of a rig that no log taught."""
    for described, is_said in ((rig, 0.0), (rig.bare(), 1.0)):
        watch = Watch(LiveEstimator(described).estimator)
        sample = np.zeros(watch.sample.size)
        values = [column[0] for column in LOGS[0].channels.values()]
        for name in ("first", "mask", "variances", "touched"):
            sample[watch.sample[name]] = 1.0
        sample[watch.sample["values"]] = values
        _, findings = watch.function()(watch.begun(), sample)
        assert float(findings[watch.findings["touched"]]) == is_said


@pytest.mark.parametrize(("word", "is_felt"), [("touched", True), ("missing", False)])
def test_contacts_of_what_logs_taught_are_those_that_its_forces_say(
    rig: Rig, word: Health, is_felt: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    contact = JointContact("finger", 0.9, 0.1, 0.02, 1.5)
    for described, expected in ((rig, is_felt), (rig.bare(), True)):
        monitor = Monitor(LiveEstimator(described))
        monkeypatch.setattr(type(monitor._live), "contacts", (contact,))
        (said,) = monitor._contacts([(word, "")])
        assert (said.probability, said.since) == ((0.9, 1.5) if expected else (0.0, 0.0))
        assert (said.torque, said.torque_std) == (0.1, 0.02)


def test_where_no_log_has_been_it_is_said(rig: Rig) -> None:
    log = finger_log(11, 20.0)
    [learned] = rig.map.efforts  # type: ignore[union-attr]
    name = learned.channels[0]
    low, high = learned.reach[name]
    span = learned.high[0] - learned.low[0]
    assert (low, high) == pytest.approx((learned.low[0] - 0.1 * span, learned.high[0] + 0.1 * span))
    live = Monitor(LiveEstimator(rig))
    inside, beyond = samples_of(log, live.channels)[[0, 0]]
    inside[live.channels.index(name)] = high - 1e-3 * span
    beyond[live.channels.index(name)] = high + 1e-3 * span
    assert "outside" not in live.take(0.0, inside).health
    reading = live.take(0.01, beyond)
    assert (reading.health, reading.detail) == ("outside", f"{name} is where no log has been")


def costs_of(part: Any, time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return T² and its spread along rows of all channels, (k,) each."""
    learned, shape = part.learned, part.shape
    function = forces_function(shape, len(learned.joints))
    parameters = forces_parameters(learned)
    rows = values[:, part.read]
    there = np.ones(shape.channels)
    memory = begun_by(learned, ca.DM(rows[0, : shape.channels]), ca.DM(there))
    found = []
    for step, row in zip(np.diff(time, prepend=time[0]), rows):
        positions, forces = row[: shape.channels], row[shape.channels :]
        square, spread, memory = function(memory, step, positions, there, forces, parameters)
        found.append((float(square), float(spread)))
    squares, spreads = np.array(found).T
    return squares, spreads


def test_the_means_are_those_of_the_errors_on_the_log(rig: Rig) -> None:
    """m⁺ = m + dt/min(T, T₁ + t) (min(T², c) − m), with e by the features over the whole log; its
    variance is larger while nobody knows on which side of its play a drive is.
    """
    log = LOGS[0]
    [learned] = rig.map.efforts  # type: ignore[union-attr]
    monitor, count = Monitor(LiveEstimator(rig)), 1000
    watch, samples = Watch(monitor._live.estimator), samples_of(log, monitor.channels)
    for time, sample in zip(log.time[:count], samples):
        monitor.take(float(time), sample)
    [part] = watch.redundancy._parts
    remembered = monitor._memory[watch.memory["learned"]]
    found = [*part.memory.view(remembered, "means"), remembered[part.memory["time"]][0]]
    shape = Shape.of(learned)
    read = np.column_stack([log.channels[name] for name in learned.channels])[:count]
    along = features_along(shape, shape.flat(learned.arrays.by_name), log.time[:count], read)
    predicted = along["features"] @ learned.arrays["mean"].T
    forces = np.column_stack([log.channels[name] for name in learned.joints])[:count]
    squares, spreads = (c[:, None] for c in costs_of(part, log.time[:count], samples[:count]))
    costs, _, _ = Redundancy.of(rig, monitor.channels).along(
        log.time[:count], samples[:count], np.isfinite(samples[:count])
    )
    np.testing.assert_allclose(costs, np.minimum(squares, MOST) + spreads, rtol=1e-9)
    assert spreads[0] > 1.0
    assert spreads[-1] < 0.1
    plain = ((forces - predicted) / learned.rms) ** 2
    assert (squares <= plain * (1 + 1e-9)).all()
    assert np.sum(squares[:50]) < 0.9 * np.sum(plain[:50])
    np.testing.assert_allclose(squares[-100:], plain[-100:], rtol=0.05)
    low, high = np.array(list(learned.reach.values())).T
    inside = np.all((read >= low) & (read <= high), axis=1)
    mean, compared = np.ones(len(AVERAGED)), 0.0
    steps = np.diff(log.time[:count], prepend=log.time[0])
    for step, square, is_inside in zip(steps, np.minimum(squares[:, 0], MOST), inside):
        compared += is_inside * step
        memory = np.minimum(AVERAGED, AVERAGED[0] + compared)
        mean = mean + is_inside * step / memory * (square - mean)
    np.testing.assert_allclose(found, [*mean, compared], rtol=1e-6)
    assert not np.allclose(mean, 1.0, atol=0.05)


@pytest.fixture(scope="module")
def ropes() -> Rig:
    bare = ropes_rig().bare()
    return bare.with_map(efforts=efforts_of([ropes_log(s, 15.0) for s in range(4)], bare, range(4)))


def late(log: Log, name: str, delay: float) -> np.ndarray:
    count = round(delay / float(np.median(np.diff(log.time))))
    values = log.channels[name]
    return np.concatenate([np.full(count, values[0]), values[:-count]])


def test_the_evidence_is_that_of_each_hypothesis_alone(ropes: Rig) -> None:
    """ln o⁺ = ln o + n/2 (u₀ − uₕ) min(dt, τ)/τ, from ln p₀ to −ln p₀, where u = min(T² + c b, c)
    and the spread of T², and b is how far a position is beyond the logs, in ranges; beside a touch
    T²₀ is at most m + ln c, where m is the largest normal mean. Each sample asks one hypothesis:
    two positions are exchanged, all but one are earlier, by what is kept, or one has another sign.
    """
    log = ropes_log(11, 6.0)
    log = changed(log, flexor_angle=late(log, "flexor_angle", 0.2))
    # what is supposed of a position jumps where its judge would not believe it
    redundancy = replace(Redundancy.of(ropes, list(log.channels)), judged=())
    [part] = redundancy._parts
    values = np.column_stack(list(log.channels.values()))
    squares, spreads = costs_of(part, log.time, values)
    ends = [np.array(end) for end in part.learned.reach.values()]

    def unlikely(square: np.ndarray, rows: np.ndarray) -> np.ndarray:
        away = [
            np.maximum(low - rows[:, at], rows[:, at] - high).clip(0.0) / (high - low)
            for at, (low, high) in zip(part.read, ends)
        ]
        return np.minimum(square + MOST * np.max(away, axis=0), MOST)

    first, second = part.read[:2]
    steps = np.diff(log.time, prepend=log.time[0])
    kept = [0] * (KEPT + 1)
    behind = values.copy()
    for k in range(1, len(values)):
        if log.time[k] - log.time[kept[0]] + steps[k] / 2 >= LATE / KEPT:
            kept = [k, *kept[:-1]]
        share = min((log.time[k] - log.time[kept[0]]) * KEPT / LATE, 1.0)
        behind[k] = (1.0 - share) * values[kept[-1]] + share * values[kept[-2]]
    exchanged, columns = values.copy(), np.arange(values.shape[1])
    exchanged[:, [first, second]] = values[:, [second, first]]
    alone = [np.where(columns == at, values, behind) for at in (first, second)]
    turned = [np.where(columns == at, -values, values) for at in (first, second)]
    supposed = [exchanged, *alone, *turned]
    n = len(supposed)
    scale = part.learned.arrays["scale"]
    ways = np.max(np.abs(values - behind)[:, part.read[:2]] / scale, axis=1)
    asked = {"evidence": np.zeros((len(values), n)), "beside_touch": np.zeros((len(values), n))}
    for h, readings in enumerate(supposed):
        theirs, wider = costs_of(part, log.time[h::n], readings[h::n])
        waits = np.diff(log.time[h::n], prepend=log.time[h])
        costs = {
            "evidence": squares,
            "beside_touch": np.minimum(squares, part.learned.normal[-1] + np.log(MOST)),
        }
        for name, cost in costs.items():
            gains = unlikely(cost[h::n], values[h::n]) - unlikely(theirs, readings[h::n])
            gains += spreads[h::n] - wider
            spans = np.minimum(waits / INDEPENDENT, ways[h::n] * waits / LATE)
            gains *= np.minimum(spans, 1.0)
            now, most = 0.0, -np.log(LATER)
            for k, gain in enumerate(gains):
                now = float(np.clip(now + len(part.learned.joints) / 2 * gain, -most, most))
                asked[name][h + n * k : h + n * k + n, h] = now
    rows = np.column_stack(
        [np.arange(len(values)) == 0, steps, values, np.ones_like(values)]
    ).astype(float)
    feed = Feed(np.zeros(redundancy.memory), rows, np.zeros(0))
    states = advance(_kernel(redundancy), feed).kernel_states
    for name, expected in asked.items():
        found = part.memory.view(states[:, : part.memory.size], name)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
        assert expected[-1, 1] > -np.log(PRIOR)
        assert np.argmax(expected[-1]) == 1
    assert redundancy.supposed(states[-1])[0] == "flexor_angle looks late"


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("late", "flexor_angle looks late"),
        ("exchanged", "flexor_angle and extensor_angle look exchanged"),
        ("sign", "flexor_angle looks as if its sign were wrong"),
        ("jump", "flexor_angle jumped"),
        ("stuck", "flexor_angle does not change"),
    ],
)
def test_a_stream_names_what_is_wrong(ropes: Rig, kind: str, said: str) -> None:
    log = ropes_log(12, 14.0)
    first, second = (log.channels[name] for name in ("flexor_angle", "extensor_angle"))
    half = len(first) // 2
    columns = {
        "late": {"flexor_angle": late(log, "flexor_angle", 0.2)},
        "exchanged": {"flexor_angle": second, "extensor_angle": first},
        "sign": {"flexor_angle": -first},
        "jump": {"flexor_angle": first + 0.5 * np.ptp(first) * (np.arange(len(first)) >= half)},
        "stuck": {"flexor_angle": np.where(np.arange(len(first)) >= half, first[half], first)},
    }
    spoilt = changed(log, **columns[kind])
    monitor = Monitor(LiveEstimator(ropes))
    samples = samples_of(spoilt, monitor.channels)
    readings = [monitor.take(time, row) for time, row in zip(log.time.tolist(), samples)]
    named = [said in reading.detail for reading in readings]
    at, begun = named.index(True), half if kind in ("jump", "stuck") else 0
    assert log.time[at] - log.time[begun] < 3.0
    assert np.mean(named[at:]) > 0.5
    assert share([one.health for one in readings[at:]], "touched", "outside") > 0.9


def test_forces_are_tested_together() -> None:
    """T² = eᵀ C⁻¹ e/n: of forces that err alike, two that differ are as improbable as they are."""
    correlation = np.array([[1.0, 0.9], [0.9, 1.0]])
    errors = np.array([[1.0, 1.0], [1.0, -1.0]])
    squares = np.mean((whitening(correlation) @ errors.T) ** 2, axis=0)
    expected = [e @ np.linalg.inv(correlation) @ e / 2 for e in errors]
    np.testing.assert_allclose(squares, expected, rtol=1e-6)


def test_it_is_kept_by_the_file_and_by_copies(rig: Rig, tmp_path: Path) -> None:
    write_fitted(tmp_path / "finger.toml", rig, rig.bare(), {}, "", None)
    assert load_rig(tmp_path / "finger.toml").map == rig.map
    monitor, log = Monitor(LiveEstimator(rig)), finger_log(11, 4.0)
    samples = samples_of(changed(log, motor_angle=-log.channels["motor_angle"]), monitor.channels)
    half = len(samples) // 2
    for time, sample in zip(log.time[:half], samples):
        monitor.take(float(time), sample)
    copy = pickle.loads(pickle.dumps(monitor))
    for time, sample in zip(log.time[half:], samples[half:]):
        assert copy.take(float(time), sample).health == monitor.take(float(time), sample).health


def test_a_sensor_that_the_rig_lacks_is_refused(rig: Rig) -> None:
    [learned] = rig.map.efforts  # type: ignore[union-attr]
    other = learned.model_copy(update={"joints": ("nobody", *learned.joints[1:])})
    with pytest.raises((RigError, ValueError), match="no sensor is called"):
        Rig.model_validate({**rig.model_dump(), "map": {"efforts": [other]}})


def test_a_diagnosis_names_forces_that_are_not_free(rig: Rig) -> None:
    log = finger_log(11, 20.0)
    assert unlike_free_motion(log, rig) == {}
    angles = log.channels["motor_angle"]
    turned = changed(log, motor_angle=2 * angles[0] - angles)
    shares = unlike_free_motion(turned, rig)
    assert list(shares) == ["motor_torque"]
    assert shares["motor_torque"] > 0.3
    said = diagnose(estimate(turned, rig), turned, rig, what_if=False)
    assert not said.consistent
    assert any(
        finding.kind == "not free" and "motor_torque" in finding.text for finding in said.findings
    )


def test_single_wrong_positions_are_no_touch(ropes: Rig) -> None:
    """A position in doubt is missing, with all that its motor reads; believed, they hide all."""
    log = ropes_log(11, 6.0)
    values = np.column_stack(list(log.channels.values()))
    redundancy = Redundancy.of(ropes, list(log.channels))
    at = list(log.channels).index("flexor_angle")
    wrong = values.copy()
    wrong[50::97, at] += 4.0
    right, spoiled, believed = (
        judging.along(log.time, readings, np.isfinite(readings))[0].mean()
        for judging, readings in (
            (redundancy, values),
            (redundancy, wrong),
            (replace(redundancy, judged=()), wrong),
        )
    )
    assert spoiled < 1.1 * right
    assert believed > 2.0 * right

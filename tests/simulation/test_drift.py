"""Hours in pieces: what comes out is one long log, and the plant's numbers follow the schedule."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from distal import estimate, load_rig, load_scenario, scenario_rig
from distal.confidence import BAND
from distal.errors import ScenarioError
from distal.logs import Log
from distal.model import Mechanism
from distal.results import save_figure
from distal.run import Hour, PieceEstimate, by_hour, estimate_pieces, plot_hours
from distal.simulation import Scenario, build_scenario, simulate_pieces, simulate_plant
from distal.simulation.drifting_plant import parameters_at

SWING = {"mean": "5 N", "amplitude": "2 N", "frequency": "0.2 Hz"}
RAW: dict[str, Any] = {
    "rig": "paper-2008",
    "set": {"drives.*.stops": ["-10 mm", "20 mm"]},
    "duration": "2.5 min",
    "drives": {"left": {"weight": SWING}, "right": {"weight": "5 N"}},
}


def scenario(**more: Any) -> Scenario:
    return build_scenario({**RAW, **more})


def whole(logs: list[Log], name: str) -> np.ndarray:
    return np.concatenate([log.channels.get(name, log.truth.get(name)) for log in logs])


def test_pieces_are_one_log() -> None:
    """The same stamps, motion and readings as of one simulation, beyond the last whole piece
    too.
    """
    described = scenario()
    rig = scenario_rig(described)
    alone, pieces = (
        simulate_plant(rig, described, 4),
        [piece.log for piece in simulate_pieces(rig, described, 4)],
    )
    assert len(pieces) == 3
    times = np.concatenate([log.time for log in pieces])
    np.testing.assert_allclose(times[: len(alone)], alone.time, atol=1e-9)
    for name in ("theta", "position_left", "tension_right", "x1", "u2"):
        np.testing.assert_allclose(
            whole(pieces, name)[: len(alone)], {**alone.truth, **alone.channels}[name], atol=1e-9
        )


def test_the_filter_goes_on_from_piece_to_piece() -> None:
    described = scenario()
    rig = scenario_rig(described)
    found = list(estimate_pieces(simulate_pieces(rig, described, 4), rig))
    alone = estimate(simulate_plant(rig, described, 4), rig)
    angles, stds = (
        np.concatenate([getattr(one, name) for one in found])[: len(alone.time)]
        for name in ("angles", "angle_stds")
    )
    np.testing.assert_allclose(angles, alone.angles, rtol=0, atol=1e-8)
    np.testing.assert_allclose(stds, alone.angle_stds, rtol=1e-5)


def test_numbers_follow_the_schedule() -> None:
    """A weight of 5 N hangs still: the slider sinks by 1/k as k falls by 60 % an hour, from one
    minute to the next.
    """
    soft = {"tendons.*.stiffness": {"per_hour": "-60 %"}}
    still = {"left": {"weight": "5 N"}, "right": {"weight": "5 N"}}
    described = scenario(schedule=soft, drives=still)
    rig = scenario_rig(described)
    ends = [piece.log.truth["position_left"][-1] for piece in simulate_pieces(rig, described)]
    stiffness = rig.tendons[0].stiffness.value * (1 - 0.6 * np.arange(3) / 60)
    grown = 5.0 / stiffness - 5.0 / stiffness[0]
    np.testing.assert_allclose(
        ends - ends[0], grown, atol=2e-5
    )  # friction of the sliders holds a little of it back


def test_a_walk_differs_from_seed_to_seed_and_has_its_size() -> None:
    described = scenario(
        schedule={"tendons.*.stiffness": {"walk": "50 %"}},
        drives={k: {"weight": "5 N"} for k in ("left", "right")},
    )
    rig = scenario_rig(described)
    first, again, other = (
        [piece.log.truth["position_left"][-1] for piece in simulate_pieces(rig, described, seed)]
        for seed in (1, 1, 2)
    )
    assert first == again
    # the first draw of a minute: 50 % per hour is 50 % √(1/60)
    stiffness = rig.tendons[0].stiffness.value
    soft = stiffness * (1 + 0.5 * np.sqrt(1 / 60) * np.random.default_rng([2, 1]).normal())
    assert other[1] - other[0] == pytest.approx(5.0 / soft - 5.0 / stiffness, abs=5e-5)
    assert first[1] != other[1]


def test_a_rezero_pulls_the_joint_to_a_known_angle_and_the_filter_reads_it() -> None:
    """Every minute the left drive pulls the link to its stop at 10°; the filter is surer after
    it.
    """
    described = scenario(
        set={**RAW["set"], "joints.link.stops": ["-25 deg", "10 deg"]},
        rezero={
            "every": "1 min",
            "lasts": "4 s",
            "angle": "10 deg",
            "std": "0.2 deg",
            "drives": {"left": {"weight": "16 N"}, "right": {"weight": "2 N"}},
        },
    )
    rig = scenario_rig(described).with_values({"sensors.x1.bias": {"value": 0.0, "std": "1 mm"}})
    built = described.model_copy(update={"plant": {"sensors.x1.bias": {"value": 1e-3}}})
    pieces = list(simulate_pieces(rig, built))
    known = np.concatenate([piece.known for piece in pieces])
    times = np.concatenate([piece.log.time for piece in pieces])
    identified = np.isfinite(known)
    np.testing.assert_allclose(times[identified][[0, -1]], [62.0, 123.99], atol=0.011)
    assert identified.sum() == 400
    assert np.all(known[identified] == np.deg2rad(10.0))
    assert (
        np.abs(np.rad2deg(whole([piece.log for piece in pieces], "theta")[identified]) - 10.0).max()
        < 0.3
    )
    blind, identified_of = (
        list(estimate_pieces(pieces, rig, rezero)) for rezero in (None, built.rezero)
    )
    assert identified_of[0].angle_stds.mean() == pytest.approx(blind[0].angle_stds.mean(), rel=0.02)
    assert identified_of[2].angle_stds.mean() < 0.9 * blind[2].angle_stds.mean()
    for found in (blind, identified_of):
        wrong = np.abs(found[2].angles - found[2].truths) / found[2].angle_stds
        assert np.mean(wrong < 1.96) > 0.9


def test_what_is_wrong_is_said() -> None:
    rig = load_rig("paper-2008")
    for raw, said in (
        (
            {"schedule": {"tendons.*.stifness": {"per_hour": 0.1}}},
            "the plant has no number 'tendons.*.stifness'; did you mean",
        ),
        (
            {
                "rezero": {
                    "every": "1 s",
                    "lasts": "2 s",
                    "angle": 0.0,
                    "drives": {"left": {"weight": "1 N"}},
                }
            },
            "leave time between",
        ),
    ):
        with pytest.raises(ScenarioError, match=said.replace("*", r"\*")):
            next(iter(simulate_pieces(rig, scenario(**raw))))
    with pytest.raises(ScenarioError, match=r"has a \[schedule\] or \[rezero\], which need pieces"):
        simulate_plant(rig, scenario(schedule={"tendons.*.stiffness": {"per_hour": 0.1}}))
    assert parameters_at(Mechanism(rig), "tendons.left.stiffness") == parameters_at(
        Mechanism(rig), "tendons.0.stiffness"
    )
    assert len(parameters_at(Mechanism(rig), "tendons.*.stiffness")) == 2


def test_hours_are_counted(tmp_path: Path) -> None:
    """Pieces of three hours: errors of 1 inside a band of ±1.96, then of 3 outside."""
    ones = np.ones((3, 1))
    pieces = [
        PieceEstimate(Log(begin + np.arange(3.0), {}, {}, "a"), size * ones, ones, 0 * ones)
        for begin, size in ((0.0, 1.0), (3600.0, 3.0), (7140.0, 3.0), (7200.0, 3.0))
    ]
    found = by_hour(iter(pieces))
    band = pytest.approx(1.959963984540054)
    assert found == (Hour(0, 1.0, 1.0, band), Hour(1, 3.0, 0.0, band), Hour(2, 3.0, 0.0, band))
    save_figure(plot_hours({"one": found}), tmp_path / "hours.png")
    assert (tmp_path / "hours.png").stat().st_size > 5000


@pytest.mark.slow
def test_six_hours_are_streamed() -> None:
    """A quarter of an hour of the shipped scenario: the band holds."""
    described = load_scenario("six-hours").model_copy(update={"duration": 900.0})
    rig = scenario_rig(described)
    (hour,) = by_hour(estimate_pieces(simulate_pieces(rig, described), rig))
    assert hour.inside > 0.9


def test_each_hours_curves_are_error_band_and_share(tmp_path: Path) -> None:
    """Two pieces of hours 0 and 1, typed out: RMS, share inside and mean half-width; the figure
    shows these numbers.
    """
    rng = np.random.default_rng(5)
    pieces: list[Any] = []
    for begin in (0.0, 1800.0, 3600.0):
        time = begin + np.arange(100) * 10.0
        stds, truths = rng.uniform(0.01, 0.03, (100, 1)), rng.normal(size=(100, 1))
        angles = truths + stds * rng.normal(size=(100, 1)) * 1.5
        pieces.append(
            SimpleNamespace(
                log=SimpleNamespace(time=time), angles=angles, truths=truths, angle_stds=stds
            )
        )
    hours = by_hour(pieces)
    time = np.concatenate([piece.log.time for piece in pieces])
    errors = np.concatenate([(piece.angles - piece.truths).ravel() for piece in pieces])
    halves = np.concatenate([BAND * piece.angle_stds.ravel() for piece in pieces])
    assert [hour.index for hour in hours] == [0, 1]
    for hour in hours:
        rows = (time >= 3600 * hour.index) & (time < 3600 * (hour.index + 1))
        assert hour.rms == pytest.approx(np.sqrt(np.mean(errors[rows] ** 2)))
        assert hour.half_band == pytest.approx(np.mean(halves[rows]))
        assert hour.inside == pytest.approx(np.mean(np.abs(errors[rows]) <= halves[rows]))
    above, below = plot_hours({"one": hours}).axes
    np.testing.assert_allclose(above.lines[0].get_ydata(), np.rad2deg([hour.rms for hour in hours]))
    np.testing.assert_allclose(
        above.lines[1].get_ydata(), np.rad2deg([hour.half_band for hour in hours])
    )
    np.testing.assert_allclose(below.lines[0].get_ydata(), [100 * hour.inside for hour in hours])
    np.testing.assert_allclose(below.lines[0].get_xdata(), [1, 2])
    np.testing.assert_allclose(below.lines[1].get_ydata(), 95.0)
    low, high = below.get_ylim()
    assert low < 100 * min(hour.inside for hour in hours)
    assert high > 100.0

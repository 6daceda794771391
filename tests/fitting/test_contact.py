"""The torque from outside learned from logs: the map, its band, homing, and the kernel that carries
it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import (
    Estimate,
    LiveEstimator,
    Log,
    Rig,
    estimate,
    fit,
    learn_contact,
    load_rig,
    read_log,
)
from distal.errors import EstimationError, FitError
from distal.fitting.map_samples import torques_of
from distal.logs import write_log
from distal.regression import predict
from distal.regression.features import played
from distal.rig import build_rig, gain_of

RATE, DURATION = 100.0, 8.0


def rig() -> Rig:
    """The capstan joint with a torque sensor at the jaw that may be touched."""
    raw = load_rig("capstan-joint").model_dump()
    raw["joints"][0]["external_torque"] = {"std": 0.05, "correlation_time": 1.0}
    raw["sensors"] = [
        *raw["sensors"],
        {
            "name": "jaw_torque",
            "measures": "torque",
            "of": "jaw",
            "noise": 1e-3,
            "rate": RATE,
            "unit": "mN m",
        },
    ]
    return build_rig(raw, "touched")


def log(seed: int, share: float = 0.1, gain: float = 0.3) -> Log:
    """τ = gain · torque + 0.02 · slip + an offset of its own, with 1 mN m of noise: what the terms
    can hold.
    """
    rng = np.random.default_rng([seed, 7])
    time = np.arange(round(RATE * DURATION)) / RATE
    a, b = rng.uniform(0.2, 0.5, 2)
    position = 0.5 * np.sin(2 * np.pi * a * time + rng.uniform(0, 6)) + 0.2 * np.sin(
        2 * np.pi * b * time
    )
    effort = 0.08 * np.sin(2 * np.pi * 0.3 * time + rng.uniform(0, 6)) + 0.03 * rng.normal()
    effort += 2e-3 * rng.normal(size=len(time))
    moved = (position - played(position, 0.02)) / 0.02
    own = 0.02 * (1 + share * rng.normal())
    torque = gain * effort + own * moved + 0.01 * rng.normal() + 1e-3 * rng.normal(size=len(time))
    truth = {"theta": 0.6 * position, "external_torque": torque}
    return Log(time, {"motor_angle": position, "motor_torque": effort}, truth, f"log {seed}")


LOGS = [log(seed) for seed in range(6)]


def rms(result: Estimate) -> float:
    return float(np.sqrt(np.nanmean(result.torque_errors() ** 2)))


@pytest.mark.slow
def test_it_is_learned_and_its_band_holds() -> None:
    """After a window in which the torque is read, the error is that of the sensor; before, the
    offset is in the band.
    """
    found = learn_contact(LOGS, rig(), homing=2.0)
    assert len(found.left_out) == len(LOGS)
    assert "slip(motor_angle)" in found.learned.terms
    for seed in (11, 12, 13):
        result = estimate(log(seed), found.rig, homing=2.0)
        late = np.isfinite(result.torque_errors())
        assert late.sum() == round(RATE * (DURATION - 2.0))
        assert rms(result) < 2.5e-3
        inside = np.abs(result.torque_errors()) < 1.96 * result.external_torque_std
        assert 0.85 < inside[late].mean() <= 1.0
    unhomed = estimate(log(14), learn_contact(LOGS, rig(), scored=False).rig)
    assert np.abs(unhomed.torque_errors()).mean() < 2.5 * unhomed.external_torque_std.mean()


def test_the_filters_angle_is_none_the_wiser() -> None:
    """The learned torque stands in the result; the state that moves the joint goes on as it was."""
    plain, taught = rig(), learn_contact(LOGS, rig(), scored=False).rig
    without, with_it = (estimate(LOGS[0], each, compiled=False) for each in (plain, taught))
    np.testing.assert_allclose(with_it.theta, without.theta, atol=1e-12)
    np.testing.assert_allclose(with_it.theta_std, without.theta_std, atol=1e-12)
    assert not np.allclose(with_it.external_torque, without.external_torque)


def test_live_is_the_log_and_the_log_is_the_map() -> None:
    taught = learn_contact(LOGS, rig(), scored=False)
    one = LOGS[1]
    whole, live = estimate(one, taught.rig), LiveEstimator(taught.rig)
    samples = np.column_stack([one.channels[name] for name in live.channels])
    for k in range(200):
        live.step(one.time[k], samples[k])
        assert live.external_torques[0] == pytest.approx(whole.external_torque[k], abs=1e-12)
        assert live.external_torque_stds[0] == pytest.approx(whole.external_torque_std[k], rel=1e-9)
    assert live.torque_names == ("external_torque",)
    said = predict(taught.learned, torques_of(one, taught.rig))
    np.testing.assert_allclose(whole.external_torque, said.values, atol=2e-4)
    np.testing.assert_allclose(whole.external_torque_std, np.sqrt(said.variances), rtol=0.02)


def test_outside_the_range_the_band_grows() -> None:
    taught = learn_contact(LOGS, rig(), scored=False).rig
    one = LOGS[2]
    further = replace(
        one, channels={**one.channels, "motor_torque": one.channels["motor_torque"] * 4}
    )
    assert (
        estimate(further, taught).external_torque_std.max()
        > 3 * estimate(one, taught).external_torque_std.max()
    )


@pytest.mark.slow  # a whole fit
def test_a_fit_learns_it_and_a_file_holds_it(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path))
    described = rig()
    paths = []
    for k, one in enumerate(LOGS[:3]):
        write_log(one, described, folder / f"run_{k}.csv")
        paths.append(folder / f"run_{k}.csv")
    again = read_log(paths[0], described)
    np.testing.assert_allclose(
        again.truth["external_torque"], LOGS[0].truth["external_torque"], atol=1e-9
    )
    found = fit(paths, described, ("joints.0.friction.coefficient",), noise=False)
    assert "contact" in found.maps
    found.save(folder / "fitted.toml")
    assert load_rig(folder / "fitted.toml").contact == found.rig.contact
    assert "# contact: efforts" in (folder / "fitted.toml").read_text()


def test_what_cannot_be_learned_is_said() -> None:
    with pytest.raises(FitError, match="no log has the torque"):
        learn_contact([replace(LOGS[0], truth={"theta": LOGS[0].truth["theta"]})], rig())
    with pytest.raises(FitError, match="nothing touches 'jaw'"):
        learn_contact(LOGS, rig().with_values({"joints.0.external_torque.std": 0.0}))
    taught = learn_contact(LOGS, rig(), scored=False).rig
    with pytest.raises(EstimationError, match="says that none can occur"):
        estimate(LOGS[0], taught.with_values({"joints.0.external_torque.std": 0.0}))
    untouched = estimate(LOGS[0], load_rig("capstan-joint"), compiled=False)
    with pytest.raises(EstimationError, match="nothing touches 'jaw'"):
        _ = untouched.external_torque


def test_onsets() -> None:
    """An onset is beyond five stds, and the next one only once the torque has come back to half of
    that.
    """
    result = estimate(LOGS[0], rig(), compiled=False)
    at = result.state_names.index("external_torque")
    means, variances = np.zeros_like(result.means), np.array(result.variances)
    variances[:, at] = 1e-4
    means[100:150, at] = 0.06
    means[150:200, at] = 0.03
    means[200:250, at] = 0.06
    means[300:310, at] = -0.06
    made = replace(result, means=means, variances=variances)
    assert made.contacts() == [result.time[100], result.time[300]]
    assert made.contacts(sigmas=7.0) == []


def test_gains() -> None:
    assert gain_of(rig().sensors[0]).value == 1.0
    assert gain_of(rig().with_values({"sensors.motor_torque.gain": 1.1}).sensors[1]).value == 1.1

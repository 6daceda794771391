"""Fitting: what a plant is, is found; what logs cannot tell is said; bad logs are named."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from distal import Fit, Log, Rig, estimate, fit, load_rig
from distal.errors import DistalWarning, FitError
from distal.fitting import groups_of
from distal.fitting.parameters_and_priors import Options, choose
from tests.helpers import changed
from tests.support.plant_and_rig import FREE, drawn_plant, logs_of, start_rig, without_truth


@pytest.fixture(scope="module")
def rig() -> Rig:
    return start_rig()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.more)])
def test_stiffness_friction_and_damping_are_found(rig: Rig, seed: int) -> None:
    """From three logs of 10 s with truth: within 3 standard errors each (2 for most of 40 seeds in
    `make accuracy`).
    """
    plant, true = drawn_plant(seed)
    found = fit(logs_of(rig, plant, seed), rig, FREE)
    for name, value in zip(FREE, true):
        part = found[name]
        assert abs(part.value - value) < 3.0 * part.error, name
        assert part.error < value / 3.0, name  # and it is worth something
    assert found.converged
    assert not found.interrupted
    assert found.rig.tendons[0].stiffness.value == pytest.approx(found[FREE[0]].value, rel=1e-6)


@pytest.mark.more
@pytest.mark.slow
def test_without_truth_the_next_log_is_estimated_as_with_the_true_rig(rig: Rig) -> None:
    plant, _ = drawn_plant(4)
    found = fit([without_truth(log) for log in logs_of(rig, plant, 4)], rig)
    held = logs_of(rig, plant, 77, ("ramps", "servo"))
    exact = rig.with_values(plant)
    ours = np.sqrt(np.mean([estimate(log, found.rig).rms_error() ** 2 for log in held]))
    best = np.sqrt(np.mean([estimate(log, exact).rms_error() ** 2 for log in held]))
    assert ours <= 1.2 * best


@pytest.mark.slow
def test_what_the_logs_cannot_tell_stays_at_its_prior(rig: Rig, tmp_path: Path) -> None:
    """A joint that is only pulled, quasi-statically, tells its damping to nobody."""
    described = rig.with_values({"joints.0.damping": {"value": 1e-5, "std": 1e-6}})
    plant, _ = drawn_plant(5)
    found = fit(
        logs_of(described, {**plant, "joints.0.damping": 1e-5}, 5, ("ramps",), 5.0),
        described,
        FREE,
        noise=False,
    )
    part = found["joints.0.damping"]
    assert part.variance_reduction < 0.1
    assert abs(part.value - 1e-5) < 0.1e-6
    assert found["joints.0.friction.coefficient"].variance_reduction > 0.9
    found.save(tmp_path / "fitted.toml")
    assert load_rig(tmp_path / "fitted.toml") == found.rig


@pytest.mark.slow
def test_each_log_may_have_its_own(pulley_rig: Rig) -> None:
    described = pulley_rig.with_values(
        {f"tendons.{i}.stiffness.shared.std": 0.0 for i in (0, 1)}
        | {f"tendons.{i}.pretension": {"value": 0.0, "std": 1.0} for i in (0, 1)}
        | {f"drives.{i}.stops": ["-5 mm", "15 mm"] for i in (0, 1)}
    )
    logs = []
    for i, own in enumerate((0.2, 0.8)):
        plant = {f"tendons.{j}.pretension": own for j in (0, 1)}
        logs += logs_of(described, plant, 20 + i, ("servo",), 6.0)
    found = fit(
        logs,
        described,
        "joints.0.friction.coefficient",
        "tendons.*.pretension",
        noise=False,
    )
    assert len(found.fitted) == 2
    one, other = found["tendons.*.pretension"].per_log
    assert other - one == pytest.approx(0.6, abs=0.15)


def test_interrupted_it_keeps_the_best_so_far(rig: Rig) -> None:
    plant, _ = drawn_plant(7)
    logs = logs_of(rig, plant, 7, ("ramps",), 4.0)

    def stop(doing: str) -> None:
        if doing.endswith("step 2"):
            raise KeyboardInterrupt

    found = fit(logs, rig, FREE, progress=stop)
    assert found.interrupted
    # on the way nothing is surer than before, and no standard error is known
    assert np.isnan(found["tendons.*.stiffness"].error)
    assert found.rig.tendons[0].stiffness.shared.std == pytest.approx(
        rig.tendons[0].stiffness.shared.std, rel=0.1
    )


@pytest.fixture(scope="module")
def log() -> Log:
    return logs_of(start_rig(), drawn_plant(8)[0], 8, ("servo",), 5.0)[0]


def test_what_cannot_be_fitted(rig: Rig, log: Log) -> None:
    known = ["joints.0.friction.coefficient"]
    known += [f"tendons.{i}.stiffness.shared" for i in (0, 1)]
    known += [f"drives.{i}.friction.load" for i in (0, 1)]
    sure = rig.with_values({f"{path}.std": 0.0 for path in known})
    refused: list[tuple[list[Log], Rig, dict[str, Any], str]] = [
        ([], rig, {}, "no log came"),
        ([log], sure, {}, "has a std, so there is nothing to fit"),
        ([log], rig, {"free": "tendons.0.stiffening"}, "is zero without a std"),
        ([log], rig, {"homing": "1s"}, "number of seconds"),
    ]
    for logs, start, options, said in refused:
        with pytest.raises(FitError, match=said):
            fit(logs, start, **options)


@pytest.mark.slow
def test_forces_in_a_wrong_unit_are_doubted(rig: Rig, log: Log) -> None:
    """The priors hold what such logs cannot tell."""

    def fitted(factor: float) -> Fit:
        wrong = {name: factor * log.channels[name] for name in ("u1", "u2")}
        return fit(changed(log, **wrong), rig)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DistalWarning)
        assert any("do not look like this rig" in line for line in fitted(1e3).doubts)
    found = fitted(1 / 9.81)
    assert any("noise of sensors u1, u2 had to become" in line for line in found.doubts)
    assert all(abs(p.value - p.start) < 4.0 * p.prior_std for p in found.fitted if not p.noise)


def test_a_noise_may_be_asked_for(rig: Rig) -> None:
    asked = ("sensors.u1.noise", "joints.0.friction.coefficient")
    free = choose(rig, (), Options(free=asked))
    (part,) = (part for part in free if "sensors.1.noise" in part.paths)
    assert part.noise


def test_groups_are_whole_logs() -> None:
    names = ["a/run_00.csv", "a/run_01.csv", "a/run_20.csv"]
    assert groups_of(names, r"run_(.)") == ["0", "0", "2"]
    assert groups_of(names, None) == names
    for pattern, said in (
        ("run_(.", "not a regular expression"),
        ("run_.", "parenthesis"),
        ("x(.)", "does not match"),
    ):
        with pytest.raises(FitError, match=said):
            groups_of(names, pattern)
    with pytest.raises(FitError, match="at least 2 groups"):
        groups_of(names[:1], None)


@pytest.mark.more
def test_a_real_instrument(data: Path, tmp_path: Path) -> None:
    """The example on three runs: better on the class left out than a linear elastic model of all
    twelve (0.46°).
    """
    root = Path(__file__).parents[2]
    words = [
        sys.executable,
        str(root / "examples/da_vinci/grasper.py"),
        "--runs",
        "01",
        "22",
        "43",
        "--out",
        str(tmp_path),
    ]
    ran = subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    found = re.search(r"as written: mean ([\d.]+)°, (\d+) % inside", ran.stdout)
    assert found is not None
    assert float(found[1]) < 0.46
    runs = [float(rms) for rms in re.findall(r"run_\d\d: [\d.]+° -> ([\d.]+)°", ran.stdout)]
    assert len(runs) == 3
    assert max(runs) < 0.78  # the worst run of that model
    assert (tmp_path / "jaw.png").stat().st_size > 10_000
    assert load_rig(tmp_path / "fitted.toml").drives[0].hysteresis is not None


@pytest.mark.more
@pytest.mark.slow
def test_the_shipped_instrument(data: Path) -> None:
    """Of the kind of instrument: homing move 0.28° in the mean; 0.8° in the one run whose torque
    turns only after it. A point tells less of a wrist's pose.
    """
    from examples.da_vinci.logs import da_vinci_grasper

    for homing, mean, worst in ((3.0, 0.285, 0.85), (0.2, 0.5, 0.8)):
        estimates = [
            estimate(path, "da-vinci-grasper", homing=homing) for path in da_vinci_grasper()
        ]
        errors = np.rad2deg([one.rms_error() for one in estimates])
        assert errors.mean() <= mean
        assert errors.max() <= worst
        assert np.mean([one.inside_band() for one in estimates]) >= 0.88
        half = np.rad2deg(np.mean([1.96 * one.theta_std.mean() for one in estimates]))
        assert half < 3.0 * errors.mean()  # and not by width alone


@pytest.mark.more
@pytest.mark.slow
def test_on_another_simulator() -> None:
    """Fitted to one servo log, two others of the same sensors are right to 0.25°."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install '.[test]'")
    from tests import mujoco_plant

    described = load_rig("pulley-antagonist")
    logs = [
        mujoco_plant.log(s, sensors=60, link_friction=0.8 * mujoco_plant.LINK_FRICTION)
        for s in range(3)
    ]
    found = fit(logs[:1], described)
    assert found["joints.0.friction.coefficient"].value == pytest.approx(0.4, rel=0.02)
    estimates = [estimate(log, found.rig) for log in logs[1:]]
    assert np.rad2deg(np.sqrt(np.mean([one.rms_error() ** 2 for one in estimates]))) <= 0.25


def test_an_effort_that_moves_a_play_keeps_its_noise() -> None:
    """It is smoothed, not compared: a fit would only make it too small, and the play with it too
    sure.
    """
    plain = load_rig("capstan-joint")
    playing = plain.with_values({"drives.0.hysteresis.constant": {"value": 0.03, "std": 0.01}})
    reference = plain.sensors[-1]
    torque = next(sensor.name for sensor in plain.sensors if sensor.measures == "force")
    names = [
        {part.name for part in choose(rig, (reference,), Options())} for rig in (plain, playing)
    ]
    assert f"noise of sensor {torque}" in names[0] - names[1]
    assert "hysteresis constant of drive motor" in names[1]


@pytest.mark.slow
def test_the_obvious_estimator_is_learned_with_the_rig(rig: Rig, tmp_path: Path) -> None:
    """A fit to logs with truth writes [map] beside the fitted values; one without truth leaves
    it alone.
    """
    plant, _ = drawn_plant(3)
    logs = logs_of(rig, plant, 3, ("ramps", "servo"), 4.0)
    found = fit(logs, rig, FREE[:1], noise=False)
    assert found.rig.map is not None
    assert found.rig.map.readings == found.maps["readings"].maps
    assert found.maps["readings"].maps[0].logs == 2
    assert found.rig.model_copy(update={"map": None}) == rig.with_values(found.assignments())
    # what friction keeps back, over a travel of some 80°; a map that is not there would be tens of
    # degrees off
    assert estimate(logs[0], found.rig, "regression").rms_error() < np.deg2rad(5.0)
    found.save(tmp_path / "fitted.toml")
    again = fit(without_truth(logs[0]), found.rig, FREE[:1], noise=False)
    assert again.rig.map is None  # it was learned with other numbers
    again.save(tmp_path / "again.toml", (tmp_path / "fitted.toml").read_text())
    assert load_rig(tmp_path / "again.toml") == again.rig

"""Fitting: what a plant is, is found; what logs cannot tell is said; bad logs are named."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, estimate, fit, load_rig
from distal.errors import DistalWarning, FitError, LogError
from distal.fitting import AS_GIVEN, WRITTEN, groups_of
from distal.fitting.parameters_and_priors import choose
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


@pytest.mark.slow  # two fits
def test_the_same_logs_give_the_same_fit(rig: Rig) -> None:
    plant, _ = drawn_plant(3)
    log = logs_of(rig, plant, 3, ("ramps",), 1.0)
    one, other = (fit(log, rig, FREE) for _ in range(2))
    assert [part.value for part in one.fitted] == [part.value for part in other.fitted]
    assert one.rig == other.rig


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
    from tests.support.plant_and_rig import logs_of as simulated

    described = pulley_rig.with_values(
        {"tendons.0.stiffness.shared.std": 0.0, "tendons.1.stiffness.shared.std": 0.0}
    )
    described = described.with_values(
        {f"tendons.{i}.pretension": {"value": 0.0, "std": 1.0} for i in (0, 1)}
    )
    described = described.with_values(
        {"drives.0.stops": ["-5 mm", "15 mm"], "drives.1.stops": ["-5 mm", "15 mm"]}
    )
    logs = [
        log
        for i, own in enumerate((0.2, 0.8))
        for log in simulated(
            described, {f"tendons.{j}.pretension": own for j in (0, 1)}, 20 + i, ("servo",), 6.0
        )
    ]
    found = fit(
        logs,
        described,
        ("joints.0.friction.coefficient",),
        per_log=("tendons.*.pretension",),
        noise=False,
    )
    own = list(found["tendons.*.pretension"].per_log)
    assert own[1] - own[0] == pytest.approx(0.6, abs=0.15)


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


class TestBadLogs:
    @staticmethod
    def changed(
        log: Log, channels: dict[str, np.ndarray] | None = None, truth: np.ndarray | None = None
    ) -> Log:
        theta = log.truth["theta"] if truth is None else truth
        return Log(
            log.time,
            {**log.channels, **(channels or {})},
            {"theta": theta},
            "bad.csv",
            "column 'angle'",
        )

    def test_without_motion(self, rig: Rig, log: Log) -> None:
        still = {name: np.full(len(log), 4e-3) for name in ("x1", "x2")}
        with pytest.raises(FitError, match=r"bad\.csv: nothing moves"):
            fit([self.changed(log, still)], rig)

    def test_a_dead_encoder(self, rig: Rig, log: Log) -> None:
        with pytest.raises(FitError, match="is constant while the drives move"):
            fit([self.changed(log, truth=np.zeros(len(log)))], rig)

    def test_nothing_to_fit(self, rig: Rig, log: Log) -> None:
        sure = rig.with_values(
            {
                "joints.0.friction.coefficient.std": 0.0,
                "tendons.0.stiffness.shared.std": 0.0,
                "tendons.1.stiffness.shared.std": 0.0,
                "drives.0.friction.load.std": 0.0,
                "drives.1.friction.load.std": 0.0,
            }
        )
        with pytest.raises(FitError, match="has a std, so there is nothing to fit"):
            fit([log], sure)
        with pytest.raises(FitError, match=r"there is no 'frictoin'"):
            fit([log], rig, ("joints.0.frictoin.coefficient",))
        with pytest.raises(FitError, match="asked for twice"):
            fit([log], rig, ("tendons.*.stiffness", "tendons.0.stiffness"))
        with pytest.raises(FitError, match="is zero without a std"):
            fit([log], rig, ("tendons.0.stiffening",))
        with pytest.raises(FitError, match="no log came"):
            fit([], rig)


@pytest.mark.slow
def test_logs_that_do_not_look_like_the_rig(rig: Rig, log: Log) -> None:
    """Wrong units, signs and columns of forces and displacements: refused, or said where they could
    be true.
    """

    def changed(**channels: np.ndarray) -> Log:
        return Log(log.time, {**log.channels, **channels}, log.truth, "bad.csv", log.truth_source)

    u1, u2, x1, x2 = (log.channels[name] for name in ("u1", "u2", "x1", "x2"))
    for wrong in (
        {"u1": 1e3 * u1, "u2": 1e3 * u2},
        {"u1": -u1, "u2": -u2},
        {"u1": u2, "u2": u1},
        {"x1": x2, "x2": x1},
        {"x1": -x1},
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DistalWarning)
            try:
                said = list(fit([changed(**wrong)], rig).doubts)
            except FitError as problem:  # no fit at all can be made of it
                said = [str(problem)]
            meant = (
                r"do not look like this rig|errs by more than it says|"
                r"moves against|leaves all bounds"
            )
            assert any(re.search(meant, line) for line in said)
    found = fit([changed(u1=u1 / 9.81, u2=u2 / 9.81)], rig)
    assert any("noise of sensors u1, u2 had to become" in line for line in found.doubts)
    # the priors hold what such logs cannot tell
    assert all(abs(p.value - p.start) < 4.0 * p.prior_std for p in found.fitted if not p.noise)
    slow = Log(1e3 * log.time, log.channels, log.truth, "ms.csv")
    with pytest.raises(LogError, match=r"stamps are 10 s apart.*unit"):
        fit([slow], rig)
    with pytest.raises(FitError, match="holds the same as"):
        fit([log, log], rig)


@pytest.mark.slow
def test_arguments_of_the_wrong_kind(rig: Rig, log: Log) -> None:
    log = log.select(slice(0, 200))
    one = fit(log, rig, "joints.0.friction.coefficient", noise=False)
    assert [part.name for part in one.fitted] == ["friction coefficient of joint link"]
    with pytest.raises(FitError, match="number of seconds"):
        fit([log], rig, homing="1s")  # type: ignore[arg-type]
    own = fit(log, rig, ("sensors.u1.noise", "joints.0.friction.coefficient"))
    assert own["sensors.1.noise"].noise


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
def test_each_log_left_out_is_better_than_the_rig_as_it_came(rig: Rig) -> None:
    plant = {
        "joints.0.friction.coefficient": 0.62,
        "tendons.0.stiffness": 740.0,
        "tendons.1.stiffness": 740.0,
    }
    logs = logs_of(rig, plant, 11, ("ramps", "servo", "weights"), 6.0)
    found = fit(logs, rig, noise=False)
    assert [one.log for one in found.compared] == [log.source for log in logs]
    errors = {name: rms for name, rms, _ in found.scores()}
    assert errors[WRITTEN] < errors[AS_GIVEN]


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
        {part.name for part in choose(rig, (reference,), (), (), noise=True, homing=False)}
        for rig in (plain, playing)
    ]
    assert f"noise of sensor {torque}" in names[0] - names[1]
    assert "hysteresis constant of drive motor" in names[1]


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
    found.save(tmp_path / "fitted.toml")
    assert load_rig(tmp_path / "fitted.toml") == found.rig
    # what friction keeps back, over a travel of some 80°; a map that is not there would be tens of
    # degrees off
    assert estimate(logs[0], found.rig, "regression").rms_error() < np.deg2rad(5.0)
    again = fit(without_truth(logs[0]), found.rig, FREE[:1], noise=False)
    assert "readings" not in again.maps
    assert again.rig.map is None  # it was learned with other numbers
    again.save(tmp_path / "again.toml", (tmp_path / "fitted.toml").read_text())
    assert load_rig(tmp_path / "again.toml") == again.rig

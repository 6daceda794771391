"""Logs of a simulation loop of one's own."""

from __future__ import annotations

import numpy as np
import pytest

import distal
from distal import Log, Rig, estimate
from distal.errors import LogError
from distal.rig import from_mujoco
from tests.rig.mjcf.models import FINGER

mujoco = pytest.importorskip("mujoco")

STEP = 0.002


def pulled(seconds: float, text: str = FINGER) -> tuple[Rig, Log, list[float]]:
    """Return the rig, a log of a finger whose flexor is pulled harder and harder, and the pull at
    each row.
    """
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = STEP
    data, rig = mujoco.MjData(model), from_mujoco(model).rig
    recorder, pulls = distal.mujoco_recorder(model, data, rig), list[float]()
    flexor, rows = model.actuator("pull flexor").id, 0
    for _ in range(round(seconds / STEP)):
        data.ctrl[flexor] = 0.5 * data.time
        mujoco.mj_step(model, data)
        recorder.record()
        if len(recorder.log()) > rows:
            rows += 1
            pulls.append(float(data.ctrl[flexor]))
    return rig, recorder.log(), pulls


def test_what_the_sensors_read_is_what_the_tendons_do() -> None:
    rig, log, pulls = pulled(1.0)
    assert len(log) == 100  # the sensors' own rate
    np.testing.assert_allclose(np.diff(log.time), 0.01, rtol=1e-6)
    mcp, pip = log.truth["theta_mcp"], log.truth["theta_pip"]
    assert np.ptp(mcp) > 0.1
    # a length of −8 mm · mcp − 6 mm · pip: the drive takes up what the tendon is shorter; gear −1
    # turns a pull round
    np.testing.assert_allclose(log.channels["x_flexor"], 0.008 * mcp + 0.006 * pip, atol=1e-9)
    np.testing.assert_allclose(log.channels["u_flexor"], pulls, atol=1e-9)
    np.testing.assert_array_equal(log.channels["encoder_pip"], pip)
    assert not log.truth_kind.by_sensor
    assert estimate(log, rig, "adaptive").angles.shape == (100, 3)


def test_a_sensor_of_the_model_stands_before_what_is_computed() -> None:
    named = FINGER.replace(
        "</mujoco>", '<sensor><jointpos name="x_flexor" joint="thumb"/></sensor></mujoco>'
    )
    _, log, _ = pulled(0.1, named)
    assert (
        np.abs(log.channels["x_flexor"]).max()
        < 1e-3
        < np.abs(pulled(0.1)[1].channels["x_extensor"]).max() + 1e-2
    )


def test_slower_sensors_are_read_at_their_own_rate() -> None:
    model = mujoco.MjModel.from_xml_string(FINGER)
    data, rig = mujoco.MjData(model), from_mujoco(model).rig
    slow = replace_sensors(rig, "u_flexor", 25.0)
    recorder = distal.mujoco_recorder(model, data, slow)
    for k in range(40):
        data.time = 0.01 * k
        recorder.record()
    log = recorder.log()
    assert np.isfinite(log.channels["x_flexor"]).all()
    np.testing.assert_array_equal(
        np.flatnonzero(np.isfinite(log.channels["u_flexor"])), np.arange(0, 40, 4)
    )


def replace_sensors(rig: Rig, name: str, rate: float) -> Rig:
    """Return the rig with another rate of a sensor."""
    return rig.with_values({f"sensors.{name}.rate": f"{rate} Hz"})


def test_what_the_loop_knows_and_the_model_does_not() -> None:
    model = mujoco.MjModel.from_xml_string(FINGER)
    data, rig = mujoco.MjData(model), from_mujoco(model).rig
    bare = mujoco.MjSpec.from_string(FINGER)
    for actuator in list(bare.actuators):
        bare.delete(actuator)
    model = bare.compile()
    data = mujoco.MjData(model)
    recorder = distal.mujoco_recorder(model, data, rig)
    with pytest.raises(LogError, match="what do u_extensor, u_flexor read"):
        recorder.record()
    with pytest.raises(LogError, match="no sensor is called tension"):
        recorder.record({"tension": 1.0})
    recorder.record({"u_extensor": 1.5, "u_flexor": 2.5, "x_flexor": 0.003})
    log = recorder.log()
    assert [log.channels[name][0] for name in ("u_extensor", "u_flexor", "x_flexor")] == [
        1.5,
        2.5,
        0.003,
    ]
    data.time = -1.0
    with pytest.raises(LogError, match="a reset needs a new recorder"):
        recorder.record({"u_extensor": 1.5, "u_flexor": 2.5})


def test_wrong_arguments_are_named() -> None:
    model = mujoco.MjModel.from_xml_string(FINGER)
    data, rig = mujoco.MjData(model), from_mujoco(model).rig
    with pytest.raises(LogError, match="nothing was recorded"):
        distal.mujoco_recorder(model, data, rig).log()
    with pytest.raises(LogError, match=r"mujoco\.MjModel and mujoco\.MjData"):
        distal.mujoco_recorder("hand.xml", data, rig)  # type: ignore[arg-type]
    other = distal.load_rig("wrist-instrument")
    with pytest.raises(LogError, match="the model has no joint"):
        distal.mujoco_recorder(model, data, other)

"""Limits and couplings give way as MuJoCo's do, and what a model does not say is as unsure as
plants are.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal.rig import from_mujoco
from tests.rig.mjcf.models import FINGER

mujoco = pytest.importorskip("mujoco")

PAIR = """
<mujoco><compiler angle="radian"/><option timestep="5e-4" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody><body><inertial pos="0.02 0 0" mass="0.01" diaginertia="1e-6 2e-6 2e-6"/>
    <joint name="{names[0]}" axis="0 1 0" range="-0.3 0.9" {limit} armature="3e-6" damping="1e-3" stiffness="0.04"/>
    <body pos="0.04 0 0"><inertial pos="0.01 0 0" mass="0.004" diaginertia="1e-7 1e-7 1e-7"/>
      <joint name="{names[1]}" axis="0 1 0" armature="2e-6" damping="1e-3" stiffness="0.02" springref="{rest}"/></body>
  </body></worldbody>
  <tendon><fixed name="flexor"><joint joint="{names[0]}" coef="-0.008"/></fixed>{more}</tendon>
  <equality><joint joint1="{first}" joint2="{second}" polycoef="{poly} 0 0 0" {soft}/></equality>
  <actuator><motor name="pull" tendon="flexor" gear="-1"/>{pulls}</actuator></mujoco>
"""
MORE = {
    "more": '<fixed name="back"><joint joint="near" coef="0.007"/></fixed>',
    "pulls": '<motor tendon="back" gear="-1"/>',
}


def pair(**changed: object) -> object:
    """Return a model of a joint that a tendon pulls and one that is softly coupled to it."""
    given = {
        "names": ("near", "far"),
        "first": "far",
        "second": "near",
        "poly": "0.1 0.8",
        "soft": 'solref="0.03 1.2"',
    }
    given |= {"limit": "", "rest": "-0.3", "more": "", "pulls": ""}
    return mujoco.MjModel.from_xml_string(PAIR.format(**given | changed))


def at_rest(model: object, pull: float) -> np.ndarray:
    """Return the angles [rad] that MuJoCo settles at under a pull [N]."""
    data = mujoco.MjData(model)
    data.ctrl[0] = pull
    for _ in range(8000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel).max() < 1e-6
    return data.qpos.copy()


@pytest.mark.parametrize(
    "limit", ["", 'solreflimit="0.03 0.7" solimplimit="0.9 0.98 0.001"', 'solreflimit="-900 -60"']
)
def test_a_stop_gives_way_as_the_models_limit_does(limit: str) -> None:
    model = pair(limit=limit)
    joint = from_mujoco(model).rig.joints[0]
    # what the coupled joint pulls back with is the same at both pulls, but for its share of the
    # difference
    model.eq_active0[:] = 0
    near, deep = (float(at_rest(model, pull)[0]) for pull in (8.0, 14.0))
    assert near > 0.9 + 0.002  # beyond the width in which the constraint gets harder
    torque = 0.008 * 6.0 - 0.04 * (deep - near)
    assert joint.stop_stiffness.value == pytest.approx(torque / (deep - near), rel=1e-4)
    assert joint.stop_damping.value < 0.01 * joint.stop_stiffness.value


@pytest.mark.parametrize(
    ("first", "second", "poly"), [("far", "near", "0.1 0.8"), ("near", "far", "-0.125 1.25")]
)
def test_a_soft_coupling_follows_as_its_spring_lets_it(first: str, second: str, poly: str) -> None:
    model = pair(first=first, second=second, poly=poly)
    far = from_mujoco(model).rig.joints[1]
    assert far.coupled is not None
    assert far.coupled.ratio < 0.75
    for pull in (1.0, 2.0):
        near_angle, far_angle = at_rest(model, pull)
        assert abs(0.8 * near_angle + 0.1 - far_angle) > 0.02  # it is soft
        assert far.coupled.ratio * near_angle + far.coupled.offset == pytest.approx(
            far_angle, abs=1e-5
        )


def test_a_length_that_a_polynomial_misses_is_noise_of_its_position() -> None:
    imported = from_mujoco(mujoco.MjModel.from_xml_string(FINGER))
    extensor, flexor = (sensor.noise for sensor in imported.rig.sensors_of("position"))
    assert flexor == pytest.approx(2e-5)
    assert extensor > flexor


@pytest.mark.parametrize(("changed", "std"), [({}, 2e4), (MORE, 1.2e4)])
def test_stiffness_is_less_sure_where_no_drive_pulls_against_another(
    changed: dict[str, str], std: float
) -> None:
    rig = from_mujoco(pair(**changed)).rig
    assert {(tendon.stiffness.value, tendon.stiffness.std) for tendon in rig.tendons} == {
        (2e4, std)
    }

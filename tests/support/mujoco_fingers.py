"""Drawn MuJoCo models of fingers, and logs of them."""

from __future__ import annotations

import mujoco
import numpy as np

from distal import Log, Rig
from distal.arrays import Floats
from distal.rig import angle_names, from_mujoco

SECONDS = 12.0
"""Of a log [s]."""


def wandering(
    draw: np.random.Generator, n: int, least: float, most: float
) -> tuple[Floats, Floats]:
    """Return times and the forces of n tendons at them: they wander from the least on, held for a
    second now and then.
    """
    knots = np.arange(0.0, SECONDS + 1.0, 1.0)
    forces = draw.uniform(least, most, (len(knots), n))
    forces[0] = least
    for k in range(3, len(knots), 4):
        forces[k] = forces[k - 1]
    return knots, forces


PULL = (1.0, 6.0)
"""Least and largest force on the tendons of an own finger [N]."""


def own_finger(seed: int, coupled: bool) -> str:
    """Return a drawn model of a finger: flexors against an extensor (odd seeds) or against springs
    alone (even ones).
    """
    draw = np.random.default_rng([seed, 243])

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** draw.uniform())

    against, follower = seed % 2 == 1, ""
    arms = {name: [between(6e-3, 11e-3), between(4e-3, 8e-3)] for name in ("deep", "extensor")}
    lengths = [between(30e-3, 50e-3), between(20e-3, 35e-3)]
    rubs, damps, turns = between(5e-4, 5e-3), between(5e-4, 5e-3), between(1e-6, 3e-5)
    joint = f'armature="{turns}" damping="{damps}" frictionloss="{rubs}"'
    stiff = [between(0.02, 0.04) if against else between(0.04, 0.07) for _ in range(2)]
    heavy = [between(5e-3, 20e-3) for _ in range(2)]
    wrap, height = between(3e-3, 4e-3), between(5e-3, 7e-3)
    if coupled:
        follower = f"""<body name="distal" pos="{lengths[1]} 0 0">
          <inertial pos="0.01 0 0" mass="0.004" diaginertia="1e-7 1e-7 1e-7"/>
          <joint name="dip" axis="0 1 0" range="0 1.6" armature="{turns}" damping="{damps / 2}"
            stiffness="{stiff[1] / 4}"/></body>"""
    tie = (
        f'<equality><joint joint1="dip" joint2="pip" solref="{between(0.005, 0.04)} 1"/></equality>'
        if coupled
        else ""
    )
    fixed = "".join(
        f'<fixed name="{name}"><joint joint="mcp" coef="{side * arms[name][0]}"/>{pip}</fixed>'
        for name, side, pip in [
            ("deep", -1, f'<joint joint="pip" coef="{-arms["deep"][1]}"/>'),
            *(
                [("extensor", 1, f'<joint joint="pip" coef="{arms["extensor"][1]}"/>')]
                if against
                else []
            ),
        ]
    )
    names = ["deep", "shallow", *(["extensor"] if against else [])]
    motors = "".join(f'<motor name="pull {name}" tendon="{name}" gear="-1"/>' for name in names)
    return f"""<mujoco model="own finger"><compiler angle="radian"/>
  <option timestep="5e-4" integrator="implicitfast"/>
  <worldbody><body name="palm"><geom size="0.01" mass="0.1"/><site name="a" pos="-0.005 0 {-height}"/>
    <body name="proximal" pos="0.01 0 0"><inertial pos="0.02 0 0" mass="{heavy[0]}" diaginertia="1e-6 2e-6 2e-6"/>
      <joint name="mcp" axis="0 1 0" range="-0.3 1.5" stiffness="{stiff[0]}" {joint}/>
      <geom name="knuckle" type="cylinder" size="{wrap} 0.01" quat="0.7071 0.7071 0 0"
        contype="0" conaffinity="0" mass="0"/>
      <site name="side" pos="0 0 -0.02"/><site name="b" pos="0.012 0 {-height}"/>
      <body name="middle" pos="{lengths[0]} 0 0"><inertial pos="0.01 0 0" mass="{heavy[1]}" diaginertia="1e-7 4e-7 4e-7"/>
        <joint name="pip" axis="0 1 0" range="0 1.6" stiffness="{stiff[1]}" {joint}/>{follower}
      </body></body></body></worldbody>
  <tendon>{fixed}
    <spatial name="shallow"><site site="a"/><geom geom="knuckle" sidesite="side"/><site site="b"/></spatial></tendon>
  {tie}<actuator>{motors}</actuator></mujoco>"""


STEPS = 20
"""Of the simulation between two samples."""


def unstretched(seed: int, coupled: bool) -> tuple[Rig, Log]:
    """Return the rig of an own finger, and its log: tendons that do not stretch, no noise."""
    model = mujoco.MjModel.from_xml_string(own_finger(seed, coupled))
    data, rig = mujoco.MjData(model), from_mujoco(model).rig
    rest, now = mujoco.MjData(model), mujoco.MjData(model)
    mujoco.mj_forward(model, rest)
    knots, forces = wandering(np.random.default_rng([seed, 244]), model.nu, *PULL)
    rows, count = list[list[float]](), 0
    while data.time < SECONDS:
        data.ctrl[:] = [np.interp(data.time, knots, column) for column in forces.T]
        mujoco.mj_step(model, data)
        if count % STEPS == 0:
            # after a step MuJoCo's lengths and forces are still those before it
            mujoco.mj_copyData(now, model, data)
            mujoco.mj_forward(model, now)
            shorter = rest.ten_length - now.ten_length
            pulls = dict(zip((model.tendon(i).name for i in model.actuator_trnid[:, 0]), range(9)))
            rows.append(
                [data.time]
                + [
                    float(
                        now.qpos[model.joint(sensor.of).qposadr[0]]
                        if sensor.measures == "angle"
                        else shorter[model.tendon(sensor.of).id]
                        if sensor.measures == "position"
                        else now.actuator_force[pulls[sensor.of]]
                    )
                    for sensor in rig.sensors
                ]
            )
        count += 1
    time, *columns = np.array(rows).T
    channels = {sensor.name: column for sensor, column in zip(rig.sensors, columns)}
    angles = angle_names(rig.joint_names)
    truth = {name: channels[f"encoder_{joint}"] for name, joint in zip(angles, rig.joint_names)}
    return rig, Log(time, channels, truth)

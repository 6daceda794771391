"""A plant in another simulator: the pulley rig in MuJoCo, its friction rewritten in every step from
the tensions.
"""

from __future__ import annotations

import numpy as np

from distal import Log, load_rig
from tests.helpers import measure

R, K, C, LINK_FRICTION = 9.53e-3, 806.0, 0.2, 0.5 * 3.18e-3

XML = f"""
<mujoco>
  <option timestep="1e-4" gravity="0 0 0" integrator="implicitfast" cone="elliptic"/>
  <worldbody>
    <body><joint name="link" type="hinge" axis="0 0 1" damping="8e-3" frictionloss="1e-3"
        solreffriction="2.5e-4 1" solimpfriction="0.99 0.999 1e-6"/>
      <inertial pos="0 0 0" mass="0.084" diaginertia="1e-3 1e-3 4.239e-4"/></body>
    <body><joint name="x1" type="slide" axis="1 0 0" damping="0.5" frictionloss="1e-3"
        solreffriction="2.5e-4 1" solimpfriction="0.99 0.999 1e-6"/>
      <inertial pos="0 0 0" mass="1e-3" diaginertia="1e-6 1e-6 1e-6"/></body>
    <body><joint name="x2" type="slide" axis="1 0 0" damping="0.5" frictionloss="1e-3"
        solreffriction="2.5e-4 1" solimpfriction="0.99 0.999 1e-6"/>
      <inertial pos="0 0 0" mass="1e-3" diaginertia="1e-6 1e-6 1e-6"/></body>
  </worldbody>
  <tendon>
    <fixed name="t1" stiffness="{K}" damping="{C}" springlength="-10 0">
      <joint joint="x1" coef="1"/><joint joint="link" coef="{-R}"/></fixed>
    <fixed name="t2" stiffness="{K}" damping="{C}" springlength="-10 0">
      <joint joint="x2" coef="1"/><joint joint="link" coef="{R}"/></fixed>
  </tendon>
</mujoco>
"""


KP, KD = 2000.0, 2.0
"""Gains of the position loop on both sliders [N/m, kg/s]."""


def targets(seed: int, n: int = 1000) -> np.ndarray:
    """Return where the sliders should be, (n, 2): they move against each other, pulled apart by 3
    to 5 N.
    """
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(n)
    frequency, amplitude, apart = (
        rng.uniform(0.2, 0.5),
        rng.uniform(3e-3, 5e-3),
        rng.uniform(6e-3, 8e-3),
    )
    swing = amplitude * np.sin(2 * np.pi * frequency * time) * np.minimum(time / 0.5, 1.0)
    return np.column_stack([apart + swing, apart - swing])


def run(
    target: np.ndarray, link_friction: float = LINK_FRICTION, slider_friction: float = 2e-3
) -> dict[str, np.ndarray]:
    """Return θ, x1, x2, u1 and u2 at every 10 ms while both sliders follow `target`, (n, 2) [m]."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.qpos[1:] = KP / (KP + K) * target[0]
    rows = []
    for before, after in zip(target, np.vstack([target[1:], target[-1:]])):
        for part in range(100):
            aim = before + part / 100 * (after - before)
            pull = KP * (aim - data.qpos[1:]) - KD * data.qvel[1:]
            if part == 0:
                rows.append(np.concatenate([data.qpos, pull]))
            data.qfrc_applied[1:] = pull
            lengths = np.array([data.qpos[1] - R * data.qpos[0], data.qpos[2] + R * data.qpos[0]])
            tensions = np.maximum(K * lengths, 0.0)
            model.dof_frictionloss[:] = [
                link_friction * tensions.sum(),
                *(slider_friction * tensions),
            ]
            mujoco.mj_step(model, data)
    motion = np.array(rows).T
    return dict(zip(("theta", "x1", "x2", "u1", "u2"), motion))


def log(seed: int, sensors: int | None = None, **plant: float) -> Log:
    """Return a log of the plant with the sensors of the pulley rig (5 µm, linearity ±0.1 mm; 0.2
    N).

    `sensors` is the seed of the sensors' curves, so that several logs are of the same ones; default
    `seed`.
    """
    motion = run(targets(seed), **plant)
    rig = load_rig("pulley-antagonist")
    channels = {}
    own = np.random.default_rng(seed).spawn(len(rig.sensors))
    same = np.random.default_rng(seed if sensors is None else sensors).spawn(len(rig.sensors))
    for sensor, noise, curve in zip(rig.sensors, own, same):
        exact = sensor.model_copy(update={"noise": 0.0})
        random = sensor.model_copy(update={"linearity": 0.0})
        bent = measure(exact, motion[sensor.name], (-8e-3, 16e-3), curve)
        channels[sensor.name] = measure(random, bent, (-8e-3, 16e-3), noise)
    return Log(
        0.01 * np.arange(len(motion["theta"])),
        channels,
        {"theta": motion["theta"]},
        f"MuJoCo, seed {seed}",
    )

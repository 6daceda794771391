"""A rig in MuJoCo, by its model alone and with `distal.bridges.mujoco.Tendons`: the time of a step,
and how far its joints are from those of other plants whose drives went the same way.

    python -m benchmarks.mujoco_tendons
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter

import mujoco
import numpy as np
from tests.support.mujoco_replay import Motion, replayed, rms, stranger

from distal import Rig, load_rig, simulate
from distal.bridges.mujoco import Tendons, to_mjcf
from distal.rig import angle_names
from distal.simulation import load_scenario

STEPS = 20_000
"""Steps that are timed together."""

REPEATED = 5
"""How often; the fastest counts."""

SHEATHS = {
    "tendons.*.path": {"friction": 0.1, "wrap": "2 rad", "nodes": 2},
    "tendons.*.stiffening": "200 1/m",
}
"""What is set on a rig, so that its tendons run in sheaths and stiffen."""


def plants() -> Iterator[tuple[str, Rig, Motion]]:
    """Yield plants of distal's own simulation, then those of other code."""
    for name, scenario, values in (
        ("finger-2n", "finger", {}),
        ("finger-2n in sheaths that stiffen", "finger", SHEATHS),
        ("template", "template", {}),
        ("paper-2008-printed", "series-2", {}),
        ("lab-bench", "lab-bench", {}),
        ("wrist-instrument", "wrist", {}),
    ):
        described = load_scenario(scenario)
        rig = load_rig(name.split()[0]).with_values(values)
        log = simulate(rig, described, seed=1)
        columns = (angle_names(rig.joint_names), [f"position_{d}" for d in rig.drive_names])
        truth = (np.column_stack([log.truth[column] for column in part]) for part in columns)
        yield name, described.plant_rig(rig), Motion(log.time, *truth)
    for seed in range(4):
        yield f"servo hand {seed}", *stranger(seed, 6.0)


def step_time(rig: Rig, tendons: bool) -> float:
    """Return the time of a step [s] while the drives are pulled to and fro."""
    model = mujoco.MjModel.from_xml_string(to_mjcf(rig))
    data = mujoco.MjData(model)
    acting = Tendons(model, rig) if tendons else None
    times = []
    for _ in range(REPEATED):
        mujoco.mj_resetData(model, data)
        if acting is not None:
            acting.reset(data)
        begun = perf_counter()
        for k in range(STEPS):
            if k % 500 == 0:
                data.ctrl[:] = 0.1 * (-1) ** (k // 500)
            if acting is not None:
                acting.apply(data)
            mujoco.mj_step(model, data)
        times.append(perf_counter() - begun)
    return min(times) / STEPS


def main() -> None:
    """Print both tables."""
    print("|plant|turns by [deg]|RMS, model alone [deg]|with Tendons [deg]|ratio|")
    print("|---|---|---|---|---|")
    for name, rig, motion in plants():
        alone, helped = (
            rms(replayed(rig, motion, tendons) - motion.angles) for tendons in (False, True)
        )
        turn = np.rad2deg(np.ptp(motion.angles, axis=0).max())
        print(f"|{name}|{turn:.0f}|{alone:.3f}|{helped:.4f}|{helped / alone:.3f}|", flush=True)
    print("\n|rig|joints, drives|a step [us]|with Tendons [us]|ratio|")
    print("|---|---|---|---|---|")
    for name in ("capstan-joint", "finger-2n", "wrist-instrument", "hand"):
        rig = load_rig(name)
        alone, helped = (1e6 * step_time(rig, tendons) for tendons in (False, True))
        parts = f"{len(rig.joints)}, {len(rig.drives)}"
        print(f"|{name}|{parts}|{alone:.1f}|{helped:.1f}|{helped / alone:.2f}|", flush=True)


if __name__ == "__main__":
    main()

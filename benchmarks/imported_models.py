"""Rigs from MuJoCo models as they come, without a fit: `python -m benchmarks.imported_models
[FOLDER …]`.

Plants, drawn by seed, are MuJoCo's own; they share no code with `distal.model`. Those of the hands
in `benchmarks.models` need the folders of the unpacked wheels `playground` and `myo_sim`. Fingers
of one's own are drawn with their models: arms, springs, `frictionloss`, damping, with motors that
pull the tendons as the model has them (nothing stretches, the recorder's log), or behind drives
with a stretch that the model does not say, without a third joint or with one that is softly
coupled.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

import distal
from benchmarks.models import HANDS, SECONDS, found, plant, recorded, specification, wandering
from benchmarks.report import table
from distal import Log, Rig, estimate
from distal.rig import from_mujoco

Made = Callable[[int], tuple[Rig, Log]]

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


def unstretched(seed: int, coupled: bool) -> tuple[Rig, Log]:
    """Return the rig of an own finger, and what the recorder sees of it: tendons that do not
    stretch, no noise.
    """
    model = mujoco.MjModel.from_xml_string(own_finger(seed, coupled))
    data, rig = mujoco.MjData(model), from_mujoco(model).rig
    recorder = distal.mujoco_recorder(model, data, rig)
    knots, forces = wandering(np.random.default_rng([seed, 244]), model.nu, *PULL)
    while data.time < SECONDS:
        data.ctrl[:] = [np.interp(data.time, knots, column) for column in forces.T]
        mujoco.mj_step(model, data)
        recorder.record()
    return rig, recorder.log()


def stretched(seed: int, coupled: bool) -> tuple[Rig, Log]:
    """Return the rig of an own finger, and a log of it behind drives, with a stretch, friction,
    noise: `models.plant`.
    """
    text = own_finger(seed, coupled)
    rig = from_mujoco(mujoco.MjModel.from_xml_string(text)).rig
    return rig, recorded(plant(mujoco.MjSpec.from_string(text), rig, seed), rig, 10 * seed, *PULL)


def of_hand(folders: list[Path], name: str) -> Made:
    """Return what makes the rig and a log of one of `HANDS`."""
    rig = found(folders, name)[0].rig
    return lambda seed: (
        rig,
        recorded(plant(specification(folders, name), rig, seed), rig, 10 * seed),
    )


def kinds(folders: list[Path]) -> dict[str, Made]:
    """Return what is tried, by name."""
    hands = {name: of_hand(folders, name) for name in HANDS} if folders else {}
    return hands | {
        "own finger": lambda seed: unstretched(seed, False),
        "own finger, stretch": lambda seed: stretched(seed, False),
        "own finger, soft coupling": lambda seed: unstretched(seed, True),
        "own finger, soft coupling, stretch": lambda seed: stretched(seed, True),
    }


def figures(rig: Rig, log: Log) -> tuple[float, float, float]:
    """Return RMS error, mean over the joints, and median half-width of the band [deg], and the
    share inside it [%].
    """
    got = estimate(log, rig, "adaptive")
    off = got.angles - np.column_stack([log.truth[f"theta_{joint.name}"] for joint in rig.joints])
    wide = 1.96 * got.angle_stds
    rms = np.sqrt(np.mean(off**2, axis=0)).mean()
    return (
        float(np.rad2deg(rms)),
        float(np.rad2deg(np.median(wide))),
        100 * float(np.mean(np.abs(off) <= wide)),
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.imported_models", description=__doc__
    )
    parser.add_argument("folders", nargs="*", type=Path, help="with models")
    parser.add_argument("--seeds", type=int, default=10, help="plants of each kind")
    parser.add_argument("--first-seed", type=int, default=11)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for name, made in kinds(given.folders).items():
        values = np.array(
            [
                figures(*made(seed))
                for seed in range(given.first_seed, given.first_seed + given.seeds)
            ]
        )
        rms, wide, inside = values.T
        rows.append(
            [
                name,
                f"{np.median(rms):.2f}",
                f"{rms.max():.2f}",
                f"{np.median(wide):.2f}",
                f"{inside.mean():.0f}",
                ", ".join(f"{share:.0f}" for share in sorted(inside)),
            ]
        )
        print(*rows[-1], flush=True)
    columns = [
        "model",
        "RMS, median [°]",
        "largest",
        "half-width, median [°]",
        "inside [%]",
        "each plant",
    ]
    table(
        "imported-models",
        f"Imported models without a fit, {given.seeds} plants each",
        columns,
        rows,
    )


if __name__ == "__main__":
    main()

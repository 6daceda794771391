"""Rigs from MuJoCo models as they come, without a fit: `python -m benchmarks.imported_models
[FOLDER …]`.

Plants, drawn by seed, are MuJoCo's own; they share no code with `distal.model`. Those of
`HANDS` need the folders of the unpacked wheels `playground` and `myo_sim`. Fingers
of one's own are drawn with their models: arms, springs, `frictionloss`, damping, with motors that
pull the tendons as the model has them (nothing stretches, the recorder's log), or behind drives
with a stretch that the model does not say, without a third joint or with one that is softly
coupled.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from tests.support.mujoco_fingers import PULL, SECONDS, own_finger, unstretched, wandering

from benchmarks.report import table
from benchmarks.shell import estimate
from distal import Log, Rig
from distal.rig import Imported, from_mujoco
from distal.rig.mjcf_bodies import tendon_slopes

Floats = NDArray[np.float64]
Made = Callable[[int], tuple[Rig, Log]]

HANDS = {
    "Aero, index": ("right_hand.xml", "right_index_f_link"),
    "Aero, thumb": ("right_hand.xml", "right_t_link"),
    "MyoFinger": ("motorfinger_v0.xml", None),
}
"""Name → file, and the body whose joints are taken."""


STEP, PERIOD = 1e-4, 0.01


def loaded(path: Path) -> mujoco.MjModel:
    """Return a model from its file, without its meshes, whose files the wheels do not have."""
    spec = mujoco.MjSpec.from_file(str(path))
    kinds = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
    for geom in list(spec.geoms):
        if geom.type in kinds:
            spec.delete(geom)
    for kind in ("materials", "textures", "meshes", "hfields", "skins"):
        for asset in list(getattr(spec, kind)):
            spec.delete(asset)
    for part in (*spec.geoms, *spec.sites, *spec.tendons):
        part.material = ""
    return spec.compile()


def found(folders: list[Path], name: str) -> tuple[Imported, mujoco.MjModel]:
    """Return the rig of one of `HANDS`, and its model."""
    file, chain = HANDS[name]
    path = next(each for folder in folders for each in folder.rglob(file))
    model = loaded(path)
    return from_mujoco(model, chain), model


@dataclass(frozen=True)
class Plant:
    """What a rig is in truth: a model with drives, series stiffness, friction along the path and
    pre-tension.
    """

    model: mujoco.MjModel
    tendons: list[int]
    joints: list[int]
    drives: list[int]
    stiffness: Floats
    pretension: Floats
    load: Floats


def specification(folders: list[Path], name: str) -> mujoco.MjSpec:
    """Return one of `HANDS` as MuJoCo edits it."""
    file, _ = HANDS[name]
    return mujoco.MjSpec.from_file(
        str(next(each for folder in folders for each in folder.rglob(file)))
    )


def plant(spec: mujoco.MjSpec, rig: Rig, seed: int) -> Plant:
    """Return a drawn plant: stiffness within a factor of 2.5, friction along the path 2 to 15 %,
    joint friction ±20 %.
    """
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            spec.delete(geom)
    for kind in (spec.meshes, spec.actuators, spec.sensors):
        for one in list(kind):
            spec.delete(one)
    kept = {joint.name for joint in rig.joints}
    for joint in spec.joints:
        if joint.name not in kept:
            joint.frictionloss = 1e3  # what the rig holds is held
    for tendon in rig.tendons:
        body = spec.worldbody.add_body(name=f"drive_{tendon.name}", pos=[0, 0, -1])
        body.add_joint(
            name=f"drive_{tendon.name}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[1, 0, 0],
            damping=[5.0, 0, 0],
        )
        body.mass, body.inertia, body.explicitinertial = 0.02, [1e-6] * 3, True
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = 0, 0
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = spec.compile()
    draw, n = np.random.default_rng([seed, 241]), len(rig.tendons)
    model.dof_frictionloss[:] *= draw.uniform(0.8, 1.2, model.nv)
    return Plant(
        model,
        [model.tendon(tendon.name).id for tendon in rig.tendons],
        [model.joint(joint.name).id for joint in rig.joints],
        [int(model.joint(f"drive_{tendon.name}").dofadr[0]) for tendon in rig.tendons],
        2e4 * 2.5 ** draw.uniform(-1, 1, n),
        draw.uniform(0.0, 2.0, n),
        draw.uniform(0.02, 0.15, n),
    )


def recorded(of: Plant, rig: Rig, seed: int, least: float = 2.0, most: float = 15.0) -> Log:
    """Return a log of a plant under `wandering` forces [N]."""
    model, data, draw = of.model, mujoco.MjData(of.model), np.random.default_rng([seed, 242])
    mujoco.mj_forward(model, data)
    zero, n = data.ten_length[of.tendons].copy(), len(of.tendons)
    knots, forces = wandering(draw, n, least, most)
    ends = of.joints
    rows, every = [], round(PERIOD / STEP)
    slopes = np.zeros((n, model.nv))
    for i in range(round(SECONDS / STEP) + 1):
        u = np.array([np.interp(i * STEP, knots, forces[:, k]) for k in range(n)])
        slopes[:] = tendon_slopes(model, data)[of.tendons]
        x = data.qpos[[int(model.jnt_qposadr[model.dof_jntid[d]]) for d in of.drives]]
        tension = np.maximum(
            of.pretension + of.stiffness * (x + data.ten_length[of.tendons] - zero), 0.0
        )
        data.qfrc_applied[:] = -slopes.T @ tension
        data.qfrc_applied[of.drives] += u - tension
        model.dof_frictionloss[of.drives] = of.load * tension
        if i % every == 0:
            read = x + 2e-5 * draw.normal(size=n)
            rows.append(
                [
                    i * STEP,
                    *read,
                    *(u + 0.2 * draw.normal(size=n)),
                    *data.qpos[model.jnt_qposadr[ends]],
                ]
            )
        mujoco.mj_step(model, data)
    values = np.array(rows)
    positions = [sensor.name for sensor in rig.sensors_of("position")]
    efforts = [sensor.name for sensor in rig.sensors_of("force")]
    angles = values[:, 1 + 2 * n :]
    read = np.deg2rad(0.1) * np.round(angles / np.deg2rad(0.1))
    channels = {name: values[:, 1 + k] for k, name in enumerate(positions)}
    channels |= {name: values[:, 1 + n + k] for k, name in enumerate(efforts)}
    channels |= {f"encoder_{joint.name}": read[:, k] for k, joint in enumerate(rig.joints)}
    truth = {f"theta_{joint.name}": angles[:, k] for k, joint in enumerate(rig.joints)}
    return Log(values[:, 0], channels, truth, "MuJoCo")


def stretched(seed: int, coupled: bool) -> tuple[Rig, Log]:
    """Return the rig of an own finger, and a log of it behind drives, with a stretch, friction,
    noise.
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

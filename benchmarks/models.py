"""Rigs from MuJoCo models: which models go through, how well their tendons are met, and what is
estimated with them.

`python -m benchmarks.models FOLDER …` takes every XML file below the folders (unpacked wheels:
`playground`, `gymnasium-robotics`, `myo_sim`). `--tendons` compares lengths and moment arms with
MuJoCo on 1,000 fresh poses; `--estimates` runs a plant in MuJoCo, to which drives, series
stiffness, friction along the path and pre-tension are added, and estimates with the rig as it came
and after a fit to three logs with encoders. Plants share no code with `distal.model`. `--hands`
times a hand of five fingers beside one.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from tests.hand_rigs import hand
from tests.support.mujoco_fingers import SECONDS, wandering

from benchmarks.report import table
from benchmarks.shell import estimate
from distal import LiveEstimator, Log, Rig, fit
from distal.errors import DistalError
from distal.estimators import make_estimator
from distal.rig import Imported, Tendon, from_mujoco
from distal.rig.mjcf_bodies import at_poses, over_ranges, tendon_slopes

Floats = NDArray[np.float64]


HANDS = {
    "Aero, index": ("right_hand.xml", "right_index_f_link"),
    "Aero, thumb": ("right_hand.xml", "right_t_link"),
    "MyoFinger": ("motorfinger_v0.xml", None),
}
"""Name → file, and the body whose joints are taken."""

VENDORS_ARMS = {"if_tendon0": (12.49e-3, 7.32e-3, 9.0e-3)}
"""Constant moment arms in the software of the Aero Hand's vendor [m]; of other tendons those by
least squares.
"""

STEP, PERIOD = 1e-4, 0.01


def imported(folders: list[Path]) -> list[list[str]]:
    """Return a row for each thing that models with tendons become: a rig, or a line that names why
    not.
    """
    rows: dict[str, list[str]] = {}
    for path in sorted(each for folder in folders for each in folder.rglob("*.xml")):
        try:
            rig = from_mujoco(loaded(path)).rig
            said = f"{len(rig.joints)} joints, {len(rig.tendons)} tendons"
        except DistalError as problem:
            said = str(problem)
        except ValueError:
            said = "MuJoCo does not take the file; most are parts that others include"
        rows.setdefault(said, []).append(path.stem)
    return [
        [", ".join(files) if len(files) < 4 else f"{len(files)}, as {files[0]}", said]
        for said, files in rows.items()
    ]


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


def tendons(folders: list[Path]) -> Iterator[list[str]]:
    """Return a row for each tendon: what is left of its length and moment arms on poses that the
    fit has not seen.
    """
    for name in HANDS:
        rig, model = found(folders, name)
        joints = [model.joint(joint.name).id for joint in rig.rig.joints]
        poses = over_ranges(model, joints, 1000, seed=77)
        names = [joint.name for joint in rig.rig.joints]
        for tendon in rig.rig.tendons:
            t = model.tendon(tendon.name).id
            used = [k for k, joint in enumerate(names) if joint in tendon.joints]
            arms = np.array(
                [list(tendon.arms(dict(zip(names, row))).values()) for row in poses.angles]
            )
            true = -poses.arms[:, t, used]
            shares = np.abs(arms - true) / np.abs(true).max(axis=0)
            rms = np.sqrt(np.mean(shares**2, axis=0)).max()
            std = (
                float(tendon.crossings[0].scale.std)
                if tendon.crossings[0].kind == "polynomial"
                else 0.01
            )
            missed = length_rms(tendon, names, poses.angles, poses.lengths[:, t], model, joints, t)
            yield [
                name,
                tendon.name,
                f"{1e3 * missed:.3f}",
                f"{constant_rms(tendon.name, poses.angles[:, used], poses.lengths[:, t]):.2f}",
                f"{100 * rms:.2f}",
                f"{100 * std:.1f}",
                f"{100 * float((shares <= std).mean(axis=0).min()):.0f}",
            ]


def constant_rms(name: str, angles: Floats, lengths: Floats) -> float:
    """Return what constant moment arms leave of a tendon's length [mm], RMS."""
    columns = np.column_stack([angles, np.ones(len(angles))])
    arms = np.linalg.lstsq(columns, lengths, rcond=None)[0][:-1]
    if name in VENDORS_ARMS:
        arms = np.sign(arms) * VENDORS_ARMS[name]
    return float(1e3 * np.std(lengths - angles @ arms))


def length_rms(
    tendon: Tendon,
    names: list[str],
    angles: Floats,
    lengths: Floats,
    model: mujoco.MjModel,
    joints: list[int],
    t: int,
) -> float:
    """Return what is left of a tendon's length [m], RMS, by the arms along straight ways from
    zero.
    """
    home = at_poses(model, joints, np.zeros((1, len(joints)))).lengths[0, t]
    positions, weights = np.polynomial.legendre.leggauss(8)
    drawn = []
    for row in angles:
        arms = [tendon.arms(dict(zip(names, position * row))) for position in (positions + 1) / 2]
        drawn.append(
            sum(
                w / 2 * sum(a.get(n, 0.0) * q for n, q in zip(names, row))
                for w, a in zip(weights, arms)
            )
        )
    return float(np.sqrt(np.mean((lengths - home + np.array(drawn)) ** 2)))


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


def estimates(folders: list[Path], plants: int) -> Iterator[list[str]]:
    """Return a row for each plant: RMS error, mean over the joints [deg], and the share inside the
    band.
    """
    for name in HANDS:
        rig = found(folders, name)[0].rig
        for seed in range(plants):
            of = plant(specification(folders, name), rig, seed)
            logs = [recorded(of, rig, 10 * seed + k) for k in range(5)]
            began = time.process_time()
            fitted = fit(logs[:3], rig).rig
            seconds = time.process_time() - began
            row = [name, str(seed)]
            for used, by in (
                (rig, "adaptive"),
                (rig, "elastic"),
                (rig, "inextensible"),
                (fitted, "adaptive"),
            ):
                row.append(scored(logs[3:], used, by))
            yield [*row, f"{seconds:.0f}"]


def scored(logs: list[Log], rig: Rig, by: str) -> str:
    """Return RMS error, mean over joints and logs, and the share inside the band."""
    errors, inside = [], []
    for log in logs:
        got = estimate(log, rig, by)
        true = np.column_stack([log.truth[f"theta_{joint.name}"] for joint in rig.joints])
        off = got.angles - true
        errors.append(np.sqrt(np.mean(off**2, axis=0)).mean())
        inside.append(np.mean(np.abs(off) <= 1.96 * got.angle_stds))
    return f"{np.rad2deg(np.mean(errors)):.2f} ({100 * np.mean(inside):.0f})"


def hands() -> list[list[str]]:
    """Return a row for one finger and for five in one rig: microseconds of a compiled step, and of
    one live from Python.
    """
    rows = []
    for count in (1, 5):
        rig = hand(["finger-underactuated"] * count)
        estimator, live = make_estimator("adaptive", rig), LiveEstimator(rig)
        sample = np.array([0.2 if name.endswith("phi_flexor") else 0.02 for name in live.channels])
        loop, best = estimator.kernel.loop(estimator.parameters), [np.inf, np.inf]
        loop.kernel_state[:] = estimator.initial(0.0, sample).kernel_state
        loop.x[:] = [0.005, *sample, *np.ones(len(sample))]
        live.step(0.0, sample)
        for _ in range(30):
            began = time.perf_counter()
            for _ in range(500):
                loop.step()
            between = time.perf_counter()
            for _ in range(500):
                live.step(live.time + 0.005, sample)
            spent = between - began, time.perf_counter() - between
            best = [min(old, new / 500 * 1e6) for old, new in zip(best, spent)]
        rows.append([str(count), *(f"{us:.1f}" for us in best)])
    return rows


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.models", description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="with models")
    parser.add_argument("--tendons", action="store_true")
    parser.add_argument("--estimates", type=int, metavar="PLANTS")
    parser.add_argument("--hands", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.hands:
        table(
            "models-hands",
            "fingers side by side",
            ["fingers", "compiled step [µs]", "live step [µs]"],
            hands(),
        )
    elif given.tendons:
        columns = [
            "model",
            "tendon",
            "length, RMS [mm]",
            "by constant arms [mm]",
            "arms, worst RMS [%]",
            "its std [%]",
            "poses within it [%]",
        ]
        table(
            "models-tendons", "tendons on 1,000 fresh poses", columns, list(tendons(given.folders))
        )
    elif given.estimates:
        columns = [
            "model",
            "plant",
            "adaptive",
            "elastic",
            "inextensible",
            "adaptive, fitted",
            "s of fit",
        ]
        rows = []
        for row in estimates(given.folders, given.estimates):
            print(*row, flush=True)
            rows.append(row)
        table(
            "models-estimates",
            "RMS error [°], mean over joints (inside the band [%])",
            columns,
            rows,
        )
    else:
        table("models", "models", ["files", "become"], imported(given.folders))


if __name__ == "__main__":
    main()

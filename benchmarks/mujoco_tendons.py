"""A rig in MuJoCo, by its model alone and with `distal.bridges.mujoco.Tendons`: how far its joints
are from those of other plants whose drives went the same way, and the time of a step.

`python -m benchmarks.mujoco_tendons` prints it for rigs with the plants' own numbers, and then, if
there is `mujoco.sysid` (pip install 'mujoco[sysid]'), for rigs that `distal.fit` fitted to logs,
on whole logs that nothing was fitted to; `--fitted [CASE …]` only the latter. There a second rival
is the model alone with numbers by `mujoco.sysid` from the same logs, begun at the rig as it came
and at the fitted one, of which the better counts. The da Vinci instrument and the joint in two
sheaths need the folder of logs in `DISTAL_DATA`.

The da Vinci jaw is loaded, and only the torque at its motor tells how; "as loaded" it bears what
this torque leaves after the jaw's own damping. Its zeros differ between runs, so that the mean
error of the first 3 s is taken off the rest.
"""

from __future__ import annotations

import argparse
import copy
import importlib
import io
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import mujoco
import numpy as np
from examples.da_vinci.logs import da_vinci_grasper
from numpy.typing import NDArray
from tests.support.foreign_plants import finger_log, finger_rig, hand_log, hand_rig
from tests.support.hands_plants import bowden_log, bowden_rig, ropes_log, ropes_rig
from tests.support.mujoco_replay import Motion, begun, controls, driven, replayed, rms, stranger

from benchmarks.report import table
from benchmarks.touch import sheath_joint
from distal import Log, Rig, fit, load_rig, read_log, simulate
from distal.bridges.mujoco import Tendons, to_mjcf
from distal.logs import true_angles
from distal.rig import Linkage, angle_names
from distal.simulation import load_scenario

Floats = NDArray[np.float64]

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


class Case(NamedTuple):
    """A rig as it came, with logs to fit and others to judge by, in which angles have white noise
    [deg]; with `homing` [s] errors count from then on, less their mean before; `loaded` says
    whether the joint bears the motor's torque.
    """

    rig: Rig
    fitted: Sequence[Log]
    judged: Sequence[Log]
    noise: float = 0.0
    homing: float = 0.0
    loaded: bool = False


def da_vinci(_: int, loaded: bool = True) -> Case:
    """Return the da Vinci instrument; one class of motion is judged, the others are fitted."""
    rig = load_rig(Path("examples/da_vinci/start.toml"))
    logs = [read_log(path, rig) for path in da_vinci_grasper()]
    return Case(rig, logs[4:], logs[:4], homing=3.0, loaded=loaded)


def sheaths(seed: int) -> Case:
    """Return the joint between two tendons in Bowden sheaths that somebody else wrote."""
    with tempfile.TemporaryDirectory() as folder:
        drawn = sheath_joint(seed, Path(folder))
        rig = load_rig(drawn.rig)
        fitted, judged = (
            [read_log(path, rig) for path in paths] for paths in (drawn.calibration, drawn.free)
        )
    return Case(rig, fitted, judged)


def foreign(log_of: Callable[[int], Log], rig: Rig, noise: float) -> Callable[[int], Case]:
    """Return the case of a plant that shares no code with distal: three logs and one other."""

    def case(seed: int) -> Case:
        *fitted, judged = (log_of(seed + k) for k in range(4))
        return Case(rig, fitted, [judged], noise)

    return case


CASES: dict[str, Callable[[int], Case]] = {
    "da Vinci, as loaded": da_vinci,
    "da Vinci, load not given": partial(da_vinci, loaded=False),
    "joint in two sheaths": sheaths,
    "Bowden finger": foreign(partial(bowden_log, kind="calibration"), bowden_rig(), 0.03),
    "two motors": foreign(partial(ropes_log, kind="calibration"), ropes_rig(), 0.03),
    "Bowden finger, described without": foreign(finger_log, finger_rig(), 0.05),
    "two motors, described without": foreign(hand_log, hand_rig(), 0.05),
}
"""Name → its logs from a seed; of the last two rigs lack the sheath, creep and backlash."""

VARIED: dict[str, tuple[float | None, float]] = {
    "tendon_stiffness": (1.0, 2.0),
    "tendon_damping": (1e-2, 2.0),
    "tendon_lengthspring": (None, 5e-3),
    "wrap_prm": (1e-4, 0.3),
    "dof_damping": (1e-5, 2.0),
    "dof_frictionloss": (1e-5, 2.0),
    "dof_armature": (1e-7, 2.0),
    "jnt_stiffness": (1e-2, 2.0),
    "qpos_spring": (None, 2.0),
}
"""What `mujoco.sysid` varies: array of a model → (least number that it begins at, decades both
ways), or (None, by how much both ways) [SI].
"""

SETTINGS = {"max_iters": 12, "mu_factor": 10**0.5, "x_scale": "jac", "eps": 1e-6}
"""Of the optimizer of `mujoco.sysid`: with its own `mu_factor` it comes as far in twice the time,
and more iterations gain less than 1 % on the fitted logs.
"""

STEP = 1e-3
"""Step of models by `mujoco.sysid` [s]; half of it, as `Tendons` has it with hysteresis, takes
twice as long.
"""


def motion_of(log: Log, rig: Rig, loaded: bool) -> Motion:
    """Return how the drives of a rig went in a log, by the biases that were fitted."""
    places = [
        log.channels[sensor.name] - sensor.bias.value
        for name in rig.drive_names
        for sensor in rig.sensors
        if sensor.measures == "position" and sensor.of == name
    ]
    angles = true_angles(log, rig.joint_names)
    assert angles is not None
    if not loaded:
        return Motion(log.time, angles, np.column_stack(places))
    (joint,), (drive,), path = rig.joints, rig.drives, rig.tendons[0].insertion
    assert isinstance(path, Linkage)
    ratio = path.radius.value / drive.lever
    (torque,) = (log.channels[s.name] for s in rig.sensors if s.measures == "force")
    load = joint.damping.value * np.gradient(places[0], log.time) / ratio - ratio * torque
    return Motion(log.time, angles, np.column_stack(places), load[:, None])


def off(time: Floats, angles: Floats, truth: Floats, homing: float) -> Floats:
    """Return the errors of angles that count [rad], (n, n_joints)."""
    errors, early = angles - truth, time - time[0] < homing
    counting: Floats = errors[~early] - (errors[early].mean(axis=0) if homing else 0.0)
    return counting


def numbers_of(model: mujoco.MjModel, rig: Rig) -> list[tuple[str, Any]]:
    """Return (array, index) of each number that is varied; drives go their way whatever theirs."""
    joints = [model.joint(name).id for name in rig.joint_names]
    dofs, tendons = model.jnt_dofadr[joints], range(model.ntendon)
    indices: dict[str, Any] = dict.fromkeys(VARIED, dofs)
    indices |= {"tendon_stiffness": tendons, "tendon_damping": tendons, "jnt_stiffness": joints}
    indices["tendon_lengthspring"] = [(tendon, 1) for tendon in tendons]
    indices["wrap_prm"] = np.flatnonzero(np.isin(model.wrap_objid, joints))
    indices["qpos_spring"] = model.jnt_qposadr[joints]
    return [(array, index) for array in VARIED for index in indices[array]]


def varied(model: mujoco.MjModel, places: list[tuple[str, Any]], x: Floats) -> mujoco.MjModel:
    """Return the model with other numbers: x = 0 is the model itself, but for least numbers."""
    model = copy.copy(model)
    for (array, index), number in zip(places, x):
        values, least = getattr(model, array), VARIED[array][0]
        if least is None:
            values[index] += number
        else:
            size = max(abs(values[index]), least) * 10**number
            values[index] = np.copysign(size, values[index])
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def sysid_module() -> Any:
    """Return `mujoco.sysid`, None where it, or a package that it needs, is not installed."""
    try:
        module = importlib.import_module("mujoco.sysid")
    except ImportError:
        return None
    return module if hasattr(module, "optimize") else None


def identified(rig: Rig, motions: Sequence[Motion], homing: float) -> mujoco.MjModel:
    """Return the model of a rig alone, driven, with numbers by `mujoco.sysid`: least squares of the
    errors that count.
    """
    sysid, spec = sysid_module(), driven(rig)
    spec.option.timestep = STEP
    model = spec.compile()
    places = numbers_of(model, rig)
    parameters = sysid.ParameterDict()
    for array, index in places:
        span = VARIED[array][1]
        parameters.add(sysid.Parameter(f"{array} {index}", 0.0, -span, span))
    states, controlled, measured = [], [], []
    for motion in motions:
        data, (each, at) = begun(model, rig, motion), controls(model, motion)
        states.append(sysid.create_initial_state(model, data.qpos))
        # the last control is not used
        time = STEP * np.arange(len(each) + 1)
        controlled.append(sysid.TimeSeries(time, np.vstack([each, each[-1:]])))
        measured.append(sysid.TimeSeries.from_names(STEP * at, motion.angles, model))
    names = [str(k) for k in range(len(motions))]
    logs = sysid.ModelSequences("rig", spec, names, states, controlled, measured)

    def residual(_: Any, predicted: Any, log: Any, *__: Any, **___: Any) -> tuple[Any, Any, Any]:
        at = np.rint(log.times / STEP).astype(np.int64)
        angles = np.vstack([log.data[:1], predicted.data])[at]
        return np.rad2deg(off(log.times, angles, log.data, homing)).ravel(), predicted, log

    function = sysid.build_residual_fn(
        models_sequences=[logs],
        build_model=lambda given, _: varied(model, places, given.as_vector()),
        modify_residual=residual,
        n_threads=1,
    )
    size = sum(off(m.time, m.angles, m.angles, homing).size for m in motions)

    def residuals(x: Floats, given: Any) -> Any:
        try:
            return function(x, given)
        except ValueError:  # such a model diverges
            return [np.full((size, *x.shape[1:]), np.inf)], None, None

    mujoco.set_mju_user_warning(lambda _: None)
    found, _ = sysid.optimize(
        parameters, residuals, verbose=False, output=io.StringIO(), **SETTINGS
    )
    return varied(model, places, found.as_vector())


def of_case(case: Case) -> list[float]:
    """Return by how much the joints turn, and RMS errors on the logs to judge by [deg]: of the
    fitted rig's model alone, the better one by `mujoco.sysid`, and the fitted rig's with `Tendons`.
    The reference's own noise is taken off.
    """
    # what loads a joint is no part of a rig, and a fit for a simulator would take it for one
    fitted = fit(
        case.fitted,
        case.rig,
        homing=case.homing or None,
        workers=1,
        open_loop=not case.homing,
    ).rig
    known, judged = (
        [motion_of(log, fitted, case.loaded) for log in logs] for logs in (case.fitted, case.judged)
    )

    def error(tendons: bool, model: mujoco.MjModel | None = None) -> float:
        replays = ((m, replayed(fitted, m, tendons, model)) for m in judged)
        errors = [off(m.time, angles, m.angles, case.homing) for m, angles in replays]
        return float(np.sqrt(max(rms(np.concatenate(errors)) ** 2 - case.noise**2, 0.0)))

    rivals = [identified(rig, known, case.homing) for rig in (case.rig, fitted)]
    turn = max(float(np.rad2deg(np.ptp(motion.angles, axis=0).max())) for motion in judged)
    return [turn, error(False), min(error(False, rival) for rival in rivals), error(True)]


def fitted_rigs(names: Sequence[str], seed: int) -> None:
    """Print and save the table of fitted rigs."""
    if sysid_module() is None:
        print("there is no mujoco.sysid: fitted rigs are left out", file=sys.stderr)
        return
    rows = []
    for name in names or CASES:
        if "DISTAL_DATA" not in os.environ and CASES[name] in list(CASES.values())[:3]:
            print(f"DISTAL_DATA is not set: {name} is left out", file=sys.stderr)
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            turn, alone, rival, helped = of_case(CASES[name](seed))
        row = [name, f"{turn:.0f}", *(f"{each:.3f}" for each in (alone, rival, helped))]
        rows.append([*row, f"{helped / rival:.2f}"])
        print(" | ".join(rows[-1]), flush=True)
    columns = ["logs left out", "turns by [°]", "model alone [°]", "by mujoco.sysid [°]"]
    title = "RMS of joints in MuJoCo, drives as recorded, rigs fitted to other logs"
    table("mujoco-fitted", title, [*columns, "with Tendons [°]", "ratio to mujoco.sysid"], rows)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fitted", nargs="*", choices=CASES, metavar="CASE")
    parser.add_argument("--first-seed", type=int, default=7400)
    asked = parser.parse_args()
    if asked.fitted is None:
        true_rigs()
    fitted_rigs(asked.fitted or (), asked.first_seed)


def true_rigs() -> None:
    """Print the tables of rigs with the plants' own numbers, and of times."""
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

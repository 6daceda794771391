"""Record a log from a simulation that the user steps with MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from distal.errors import LogError
from distal.logs.log import Log, TruthSource
from distal.rig import Rig, Sensor, angle_names
from distal.rig.mjcf import joint_name, mujoco_module, rest_lengths, tendon_name
from distal.units import base_powers

if TYPE_CHECKING:
    import mujoco

EARLY = 1e-9
"""A sample that is due within this time is taken now [s], since sums of time steps are rounded.
Source: rounding (stamps as sums of time steps).
"""


Reader = Callable[[], float]
"""A function that returns the present reading of a sensor, in SI."""


class MujocoRecorder:
    """Records, row by row, what the sensors of a rig read in a simulation; see
    `mujoco_recorder`.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, rig: Rig, length_unit: float
    ) -> None:
        self._model = model
        self._data = data
        self._rig = rig
        # after a step MuJoCo's lengths and forces are still those before it: they are computed anew
        # in a copy of the user's state
        self._now = now = mujoco_module().MjData(model)
        joints = {joint_name(model, j): j for j in range(model.njnt)}
        names = rig.joint_names
        missing = [name for name in names if name not in joints]
        if missing:
            raise LogError(
                f"the model has no joint {', '.join(missing)}; its joints are {', '.join(joints)}"
            )
        positions = [int(model.jnt_qposadr[joints[name]]) for name in names]
        self._angles = {
            name: _entry(now, position) for name, position in zip(angle_names(names), positions)
        }
        of_joints = dict(zip(names, self._angles.values()))
        self._readers = {
            sensor.name: _own_sensor(model, now, sensor, length_unit)
            or (of_joints[sensor.of] if sensor.measures == "angle" else None)
            or _of_drive(model, now, rig, sensor, length_unit)
            for sensor in rig.sensors
        }
        self._due = dict.fromkeys(self._readers, -np.inf)
        self._times: list[float] = []
        self._rows: list[list[float]] = []
        self._truth: list[list[float]] = []

    def record(self, values: Mapping[str, float] | None = None) -> None:
        """Add a row if a sensor's next sample is due at the simulation's time; call it after each
        step.

        A sensor's rate says when its samples are due.

        Args:
            values: sensor name → reading in SI, which replaces what MuJoCo has. Give here what only
                the loop knows, such as the position of a drive that the model lacks.

        Raises:
            LogError: time goes back, a name is unknown, or neither MuJoCo nor `values` has what a
                sensor reads.
        """
        time = float(self._data.time)
        values = values or {}
        unknown = sorted(set(values) - set(self._readers))
        if unknown:
            raise LogError(
                f"no sensor is called {', '.join(unknown)}; the rig has {', '.join(self._readers)}"
            )
        readers = {
            **self._readers,
            **{name: partial(float, reading) for name, reading in values.items()},
        }
        lacking = [name for name, reader in readers.items() if reader is None]
        if lacking:
            raise LogError(
                f"what do {', '.join(lacking)} read? The model has neither sensors of these names "
                "nor tendons with "
                "an actuator that are called as their drives; give record() their values"
            )
        if self._times and time < self._times[-1]:
            raise LogError(
                f"time went back from {self._times[-1]:g} s to {time:g} s; a reset needs a new "
                "recorder"
            )
        intervals = {
            s.name: 1.0 / s.rate for s in self._rig.sensors if time >= self._due[s.name] - EARLY
        }
        if not intervals:
            return
        for name, interval in intervals.items():
            # where steps are longer than the interval, each of them is a sample
            before = max(self._due[name], time - interval) if self._times else time
            self._due[name] = before + interval
        package = mujoco_module()
        package.mj_copyData(self._now, self._model, self._data)
        package.mj_forward(self._model, self._now)
        self._times.append(time)
        self._rows.append(
            [reader() if reader and name in intervals else nan for name, reader in readers.items()]
        )
        self._truth.append([read() for read in self._angles.values()])

    def log(self) -> Log:
        """Return the log recorded so far, with the joints' angles as truth.

        Raises:
            LogError: nothing was recorded.
        """
        if not self._times:
            raise LogError("nothing was recorded; call record() after each step of the simulation")
        columns = dict(zip(self._readers, np.array(self._rows).T))
        truth = dict(zip(self._angles, np.array(self._truth).T))
        return Log(
            np.array(self._times),
            columns,
            truth,
            "MuJoCo",
            TruthSource(position="the simulation"),
        )


def mujoco_recorder(
    model: mujoco.MjModel, data: mujoco.MjData, rig: Rig, length_unit: float = 1.0
) -> MujocoRecorder:
    """Return a recorder of what a rig's sensors read, without errors, in a simulation loop of the
    user's own.

    Where the model has a sensor of the same name, its reading is taken as it is. Otherwise an angle
    is the joint's; a drive's position is how much its tendon is shorter than with all joints at
    zero, divided by the radius of a capstan; and its force is that of the actuator on this tendon.

    Args:
        data: state of the model, which the loop steps.
        rig: its joints have the names of the model's; `distal.rig.from_mujoco` makes one from the
            model.
        length_unit: metres in one unit of length of the model.

    Raises:
        LogError: these are no model and state of MuJoCo, or the model lacks a joint of the rig.
    """
    package = mujoco_module()
    if not isinstance(model, package.MjModel) or not isinstance(data, package.MjData):
        raise LogError(
            f"mujoco_recorder takes mujoco.MjModel and mujoco.MjData, {type(model).__name__} and "
            f"{type(data).__name__} came; "
            "a rig is made from a model by distal.rig.from_mujoco"
        )
    return MujocoRecorder(model, data, rig, length_unit)


def _entry(data: mujoco.MjData, position: int) -> Reader:
    return lambda: float(data.qpos[position])


def _own_sensor(
    model: mujoco.MjModel, data: mujoco.MjData, sensor: Sensor, length_unit: float
) -> Reader | None:
    """Return the reader of the model's sensor of the same name, or None where the model has
    none.
    """
    index = next((i for i in range(model.nsensor) if model.sensor(i).name == sensor.name), None)
    if index is None:
        return None
    at = int(model.sensor_adr[index])
    unit = length_unit ** base_powers(sensor.si).get("m", 0)
    return lambda: unit * float(data.sensordata[at])


def _of_drive(
    model: mujoco.MjModel, data: mujoco.MjData, rig: Rig, sensor: Sensor, length_unit: float
) -> Reader | None:
    """Return the reader of a drive's position or force, or of a tension, from the tendon in the
    model.

    The result is None where the model has no such tendon, or no actuator on it.
    """
    drive = next((drive for drive in rig.drives if drive.name == sensor.of), None)
    pulled = [
        t.name
        for t in rig.tendons
        if t.name == sensor.of or (drive is not None and t.drive == drive.name)
    ]
    tendons = {tendon_name(model, t): t for t in range(model.ntendon)}
    index = tendons.get(pulled[0]) if len(pulled) == 1 else None
    if index is None:
        return None
    lever = drive.radius.value if drive is not None and drive.kind == "capstan" else 1.0
    if sensor.measures == "position":
        names = rig.joint_names
        at_rest = rest_lengths(
            model, [j for j in range(model.njnt) if joint_name(model, j) in names]
        )[index]
        return lambda: length_unit * float(at_rest - data.ten_length[index]) / lever
    kind = int(mujoco_module().mjtTrn.mjTRN_TENDON)
    at = [
        a
        for a in range(model.nu)
        if (int(model.actuator_trntype[a]), int(model.actuator_trnid[a][0])) == (kind, index)
    ]
    if not at:
        return None
    # an actuator's force lengthens its tendon; a drive's shortens it
    gears = -model.actuator_gear[at, 0] * length_unit * lever
    return lambda: float(gears @ data.actuator_force[at])

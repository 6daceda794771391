"""The loop of plant, sensors, filter and PID as one kernel, so that a closed loop is one call of a
scan.

It has the equations of `ControlledPlant`, `SensorErrors` and `PID`, and is for rigs whose sensors
are all read once a period.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.control.controlled_plant import ControlledPlant, drive_parameters
from distal.control.pid import GAINS, memory_layout, pid_function, pid_gains_of
from distal.estimators import KernelEstimator
from distal.kernels import Feed, Kernel, Layout, advance, variances_of
from distal.model import Mechanism
from distal.rig import Rig
from distal.run import LOST
from distal.sensor_errors import (
    SENSOR,
    SensorErrors,
    quantisation_variance,
    quantised,
    quantised_values,
)
from distal.simulation.plant import PlantMotion, plant_function, rows_of
from distal.simulation.readings import Readings, reading_function


@dataclass(frozen=True)
class LoopShape:
    """All that decides the kernel of a closed loop.

    Args:
        plant: equations of the plant.
        rig: as filters and the controller know it.
        count: number of sub-steps in an interval of the plant.
        intervals: number of the plant's intervals in a period.
        controlled: indices of the joints that are controlled.
        filter: (kernel_state, x, p) → (kernel_state⁺, y); None for an encoder.
        states: number of the filter's states.
        read: indices of the sensors that the filter reads.
    """

    plant: Mechanism
    rig: Rig
    count: int
    intervals: int
    controlled: tuple[int, ...]
    filter: ca.Function | None
    states: int
    read: tuple[int, ...]

    @property
    def kernel_state(self) -> Layout:
        """Layout of the loop's kernel state."""
        nj = len(self.rig.joints)
        nd = len(self.rig.drives)
        pid = memory_layout(self.rig).size
        plant = plant_function(self.plant, self.count).numel_in(0)
        belief = 1 if self.filter is None else int(self.filter.numel_in(0))
        assert self.plant.n_bodies == nj + nd
        return Layout(
            plant=plant, efforts=nd, waiting=nd, filter=belief, angles=nj, stds=nj, pid=pid
        )

    @property
    def x(self) -> Layout:
        """Layout of a sample: the plant's inputs in each interval, the draws of the noise, the
        references.
        """
        ns = len(self.plant.rig.sensors)
        return Layout(
            rows=(5 * self.plant.n_bodies + 1, self.intervals),
            draws=ns,
            reference=len(self.controlled),
        )

    @property
    def p(self) -> Layout:
        """Layout of the loop's parameters."""
        nd = len(self.rig.drives)
        ns = len(self.plant.rig.sensors)
        return Layout(
            plant=self.plant.parameters.values.size,
            filter=1 if self.filter is None else int(self.filter.numel_in(2)),
            rig=Mechanism(self.rig).parameters.values.size,
            sensors=(SENSOR.size, ns),
            gains=(len(GAINS), len(self.controlled)),
            drives=(3, nd),
            general=3,
        )

    @property
    def y(self) -> Layout:
        """Layout of an output: the plant's output, the readings, the commands that were asked for,
        and the angles that are told afterwards, with their stds.
        """
        n = self.plant.n_bodies
        nj = len(self.rig.joints)
        nd = len(self.rig.drives)
        of_plant = 3 * n + self.plant.n_tendons
        return Layout(
            plant=of_plant, read=len(self.plant.rig.sensors), asked=nd, angles=nj, stds=nj
        )


@lru_cache(maxsize=8)
def loop_kernel(shape: LoopShape) -> Kernel:
    """Return the kernel of a closed loop, with one sample for each period."""
    kernel_state_of = shape.kernel_state
    x_of = shape.x
    p_of = shape.p
    nj = len(shape.rig.joints)
    kernel_state = ca.MX.sym("kernel_state", kernel_state_of.size)
    x = ca.MX.sym("x", x_of.size)
    p = ca.MX.sym("p", p_of.size)
    before = kernel_state_of.parts(kernel_state)
    parameters = p_of.parts(p)
    sample = x_of.parts(x)
    period, tension, encoder = (parameters["general"][i] for i in range(3))
    state = (before[name] for name in ("angles", "stds", "pid"))
    fixed = parameters["gains"], period, tension, parameters["rig"]
    memory = pid_function(shape.rig, shape.controlled)(*state, sample["reference"], *fixed)
    asked = memory_layout(shape.rig).part(memory, "commands")
    share, low, high = (parameters["drives"][i, :].T for i in range(3))
    desired = ca.fmin(ca.fmax(before["waiting"], low), high)
    moving = before["plant"]
    efforts = before["efforts"]
    rows = sample["rows"]
    step = plant_function(shape.plant, shape.count)
    y = ca.MX(0)
    bodies = shape.plant.n_bodies
    for i in range(shape.intervals):
        efforts = efforts + share * (desired - efforts)
        row = ca.vertcat(rows[:nj, i], rows[nj:bodies, i] + efforts, rows[bodies:, i])
        moving, y = step(moving, row, parameters["plant"])
    read = reading_function(shape.plant)(y, parameters["sensors"], sample["draws"])
    if shape.filter is None:
        true = y[:nj]
        belief = before["filter"]
        angles = quantised(true, encoder)
        stds = ca.MX.ones(nj) * encoder * quantisation_variance(1.0) ** 0.5
    else:
        row = ca.vertcat(period, read[list(shape.read)], ca.MX.ones(len(shape.read)))
        belief, _ = shape.filter(before["filter"], row, parameters["filter"])
        angles = belief[:nj]
        n = shape.states
        stds = ca.sqrt(ca.fmax(belief[[n + j * (n + 1) for j in range(nj)]], 0))
    after = kernel_state_of.joined(
        plant=moving,
        efforts=efforts,
        waiting=asked,
        filter=belief,
        angles=angles,
        stds=stds,
        pid=memory,
    )
    out = shape.y.joined(plant=y, read=read, asked=asked, angles=angles, stds=stds)
    return Kernel(
        ca.Function(
            "loop", [kernel_state, x, p], [after, out], ["kernel_state", "x", "p"], ["next", "y"]
        )
    )


@dataclass(frozen=True)
class Scanned:
    """A closed loop from one scan, with a row for each period.

    Args:
        motion: of the plant, at the periods' beginnings.
        readings: of all sensors, at the periods' beginnings [SI].
        estimates: angles that the controller was told [rad].
        stds: standard deviations of their errors, as told [rad].
        commands: that the controller asked for [N or N m].
    """

    motion: PlantMotion
    readings: Floats
    estimates: Floats
    stds: Floats
    commands: Floats


def scan_loop(
    controlled: ControlledPlant, errors: SensorErrors, estimator: KernelEstimator | None
) -> Scanned | None:
    """Return the closed loop of a scenario's ``[control]`` by one scan, or None if an angle was not
    always known.

    All sensors are read once a period, with `errors`. The filter is that of `estimator`; None
    stands for encoders in the joints.

    Raises:
        ScenarioError: the motion left all bounds.
    """
    prepared = controlled.prepared
    period = controlled.period
    (kernel_state, begin) = controlled.begin
    rig = prepared.rig
    plant = prepared.plant
    control = prepared.scenario.control
    assert control is not None
    encoder = control.encoder_resolution
    joints = rig.joint_names
    sensors = rig.sensor_names
    intervals = round(period / prepared.dt)
    count = len(prepared.inputs.effort) // intervals
    nj = len(joints)
    read = () if estimator is None else tuple(sensors.index(name) for name in estimator.channels)
    indices = tuple(joints.index(name) for name in control.joints)
    function, states = (
        (None, 0) if estimator is None else (estimator.kernel.function, len(estimator.state_names))
    )
    shape = LoopShape(plant, rig, prepared.count, intervals, indices, function, states, read)
    draws = errors.draws(count + 1).copy()
    first = errors.read(Readings(plant).at(begin))[0]
    if estimator is None:
        belief = np.zeros(1)
        angles = quantised_values(begin[0, :nj], encoder)
        stds = np.full(nj, encoder * quantisation_variance(1.0) ** 0.5)
    else:
        sample = first[list(read)]
        row = np.concatenate([[0.0], sample, np.ones(len(read))])
        belief = advance(
            estimator.kernel,
            Feed(estimator.initial(0.0, sample).kernel_state, row, estimator.parameters),
        ).kernel_states[0]
        angles = belief[:nj]
        stds = np.sqrt(np.maximum(variances_of(belief, states)[:nj], 0.0))
    efforts = np.zeros(2 * len(rig.drives))
    memory = np.zeros(memory_layout(rig).size)
    start = np.concatenate([kernel_state, efforts, belief, angles, stds, memory])
    time: Floats = period * np.arange(count, dtype=np.float64)
    desired = np.column_stack([joint.reference.at(time) for joint in control.joints.values()])
    rows = rows_of(prepared.inputs, prepared.dt)[: count * intervals].reshape(count, -1)
    parts = [plant.parameters.values, np.zeros(1) if estimator is None else estimator.parameters]
    parts += [
        Mechanism(rig).parameters.values,
        errors.values.ravel(),
        pid_gains_of(control.joints).T.ravel(),
    ]
    parts += [
        drive_parameters(plant.rig, prepared.dt).T.ravel(),
        np.array([period, control.co_contraction, encoder]),
    ]
    ys = advance(
        loop_kernel(shape),
        Feed(start, np.hstack([rows, draws[1:], desired]), np.concatenate(parts)),
    ).ys
    out = {name: shape.y.view(ys, name) for name in ("plant", "read", "asked", "angles", "stds")}
    motion = PlantMotion(plant, np.vstack([begin, out["plant"]]))
    motion.check()
    estimates = np.vstack([angles, out["angles"][:-1]])
    stds = np.vstack([stds, out["stds"][:-1]])
    if not (np.isfinite(estimates).all() and np.all(stds <= LOST)):
        return None
    readings = np.vstack([first, out["read"][:-1]])
    return Scanned(PlantMotion(plant, motion.y[:-1]), readings, estimates, stds, out["asked"])

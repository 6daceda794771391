"""The loop of plant, sensors, filter and PID as one kernel: a closed loop is then one call of a scan.

The same equations as `ControlledPlant`, `SensorErrors` and `PID`, for rigs whose sensors are all read once a period.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import exp, inf

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.control.pid import GAINS, LOST, UNBOUNDED, gains_of, memory_layout, pid_function
from distal.estimators import KernelEstimator
from distal.kernels import Feed, Kernel, Layout, advance
from distal.model import Mechanism
from distal.rig import Rig
from distal.sensors import SensorErrors
from distal.simulation.plant import Motion, at_rest, plant_function, rows_of
from distal.simulation.readings import SENSOR, Readings, reading_function
from distal.simulation.simulate import Prepared


@dataclass(frozen=True)
class LoopShape:
    """What decides the loop's kernel beside its functions.

    Args:
        plant: the plant's equations.
        rig: as filters and the controller know it.
        count: the plant's sub-steps in an interval.
        intervals: of the plant in a period.
        controlled: indices of the joints that are controlled.
        filter: (carry, x, p) → (carry⁺, y), with its number of states and the sensors it reads; None for an encoder.
        states: of the filter.
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
    def carry(self) -> Layout:
        """Layout of the carry."""
        nj, nd, n = len(self.rig.joints), len(self.rig.drives), self.plant.n_bodies
        moving = plant_function(self.plant, self.count).numel_in(0)
        kept = 1 if self.filter is None else int(self.filter.numel_in(0))
        assert n == nj + nd
        return Layout(
            plant=moving, efforts=nd, waiting=nd, filter=kept, angles=nj, stds=nj, pid=memory_layout(self.rig).size
        )

    @property
    def x(self) -> Layout:
        """Layout of a sample: what the scenario does in each interval, the draws of the noise, the references."""
        ns = len(self.plant.rig.sensors)
        return Layout(rows=(5 * self.plant.n_bodies + 1, self.intervals), draws=ns, reference=len(self.controlled))

    @property
    def p(self) -> Layout:
        """Layout of the numbers."""
        nd, ns = len(self.rig.drives), len(self.plant.rig.sensors)
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
        """Layout of the output: the plant's, the readings, the commands that were asked for, the angles told after."""
        n, nj, nd = self.plant.n_bodies, len(self.rig.joints), len(self.rig.drives)
        of_plant = 3 * n + self.plant.n_tendons
        return Layout(plant=of_plant, read=len(self.plant.rig.sensors), asked=nd, angles=nj, stds=nj)


@lru_cache(maxsize=8)
def loop_kernel(shape: LoopShape) -> Kernel:
    """Return the kernel of a loop, one sample for each period."""
    carry_of, x_of, p_of, nj = shape.carry, shape.x, shape.p, len(shape.rig.joints)
    carry, x, p = ca.MX.sym("carry", carry_of.size), ca.MX.sym("x", x_of.size), ca.MX.sym("p", p_of.size)
    before = {
        name: carry_of.part(carry, name) for name in ("plant", "efforts", "waiting", "filter", "angles", "stds", "pid")
    }
    numbers = {name: p_of.part(p, name) for name in ("plant", "filter", "rig", "sensors", "gains", "drives", "general")}
    period, tension, encoder = (numbers["general"][i] for i in range(3))
    memory = pid_function(shape.rig, shape.controlled)(
        before["angles"], before["stds"], before["pid"], x_of.part(x, "reference"), numbers["gains"], period, tension,
        numbers["rig"],
    )  # fmt: skip
    asked = memory_layout(shape.rig).part(memory, "commands")
    share, low, high = (numbers["drives"][i, :].T for i in range(3))
    wanted = ca.fmin(ca.fmax(before["waiting"], low), high)
    moving, efforts, rows = before["plant"], before["efforts"], x_of.part(x, "rows")
    step, y, bodies = plant_function(shape.plant, shape.count), ca.MX(0), shape.plant.n_bodies
    for i in range(shape.intervals):
        efforts = efforts + share * (wanted - efforts)
        row = ca.vertcat(rows[:nj, i], rows[nj:bodies, i] + efforts, rows[bodies:, i])
        moving, y = step(moving, row, numbers["plant"])
    read = reading_function(shape.plant)(y, numbers["sensors"], x_of.part(x, "draws"))
    if shape.filter is None:
        true, kept = y[:nj], before["filter"]
        at = ca.if_else(encoder > 0, encoder, 1)
        angles = ca.if_else(encoder > 0, ca.floor(true / at + 0.5) * at, true)
        stds = ca.MX.ones(nj) * encoder / 12**0.5
    else:
        own = read[list(shape.read)]
        kept, _ = shape.filter(
            before["filter"], ca.vertcat(period, own, ca.MX.ones(len(shape.read))), numbers["filter"]
        )
        angles, n = kept[:nj], shape.states
        stds = ca.sqrt(ca.fmax(kept[[n + j * (n + 1) for j in range(nj)]], 0))
    after = carry_of.joined(
        plant=moving, efforts=efforts, waiting=asked, filter=kept, angles=angles, stds=stds, pid=memory
    )
    out = shape.y.joined(plant=y, read=read, asked=asked, angles=angles, stds=stds)
    return Kernel(ca.Function("loop", [carry, x, p], [after, out], ["carry", "x", "p"], ["next", "y"]))


def drive_numbers(rig: Rig, dt: float) -> Floats:
    """Return of each drive the share of a command that an interval brings, and its bounds, (3, n_drives).

    Args:
        dt: length of an interval [s].
    """
    share = [1.0 - exp(-dt / drive.lag) if drive.lag > 0.0 else 1.0 for drive in rig.drives]
    high = [min(inf if drive.limit is None else drive.limit, UNBOUNDED) for drive in rig.drives]
    low = [0.0 if drive.kind == "slider" else -bound for drive, bound in zip(rig.drives, high)]
    return np.array([share, low, high])


@dataclass(frozen=True)
class Scanned:
    """A closed loop from one scan; arrays have a row for each period.

    Args:
        motion: of the plant at the beginnings of the periods.
        readings: of all sensors then [SI], (k, n_sensors).
        estimates: what the controller was told [rad], (k, n_joints).
        stds: standard deviations of their errors, as told [rad], (k, n_joints).
        commands: what it asked for [N or N m], (k, n_drives).
    """

    motion: Motion
    readings: Floats
    estimates: Floats
    stds: Floats
    commands: Floats


def scan_loop(
    prepared: Prepared, errors: SensorErrors, runner: KernelEstimator | None, encoder: float, period: float
) -> Scanned | None:
    """Return the closed loop of a scenario's ``[control]`` by one scan; None where the angle was not always known.

    Args:
        prepared: the scenario on the rig, its intervals filling the period.
        errors: of all sensors, which are read once a period.
        runner: the filter; None for encoders in the joints.
        encoder: their step [rad].
        period: of the controller [s].

    Raises:
        ScenarioError: the motion left all bounds.
    """
    rig, plant, control = prepared.rig, prepared.plant, prepared.scenario.control
    assert control is not None
    joints, sensors = [joint.name for joint in rig.joints], [sensor.name for sensor in rig.sensors]
    intervals = round(period / prepared.dt)
    count, nj = len(prepared.inputs.effort) // intervals, len(joints)
    read = () if runner is None else tuple(sensors.index(name) for name in runner.channels)
    controlled = tuple(joints.index(name) for name in control.joints)
    function, states = (None, 0) if runner is None else (runner.kernel.function, len(runner.state_names))
    shape = LoopShape(plant, rig, prepared.count, intervals, controlled, function, states, read)
    carry, begin = at_rest(plant, prepared.inputs, prepared.start, plant_kernel(plant, prepared.count))
    draws = errors.draws(count + 1).copy()
    first = errors.read(Readings(plant).at(begin))[0]
    if runner is None:
        kept = np.zeros(1)
        angles = begin[0, :nj] if encoder == 0.0 else np.floor(begin[0, :nj] / encoder + 0.5) * encoder
        stds = np.full(nj, encoder / 12**0.5)
    else:
        sample = first[list(read)]
        row = np.concatenate([[0.0], sample, np.ones(len(read))])
        kept = advance(runner.kernel, Feed(runner.initial(0.0, sample).carry, row, runner.numbers)).carries[0]
        angles, stds = kept[:nj], np.sqrt(np.maximum(kept[states : states * (states + 1) : states + 1][:nj], 0.0))
    start = np.concatenate(
        [carry, np.zeros(2 * len(rig.drives)), kept, angles, stds, np.zeros(memory_layout(rig).size)]
    )
    time: Floats = period * np.arange(count, dtype=np.float64)
    wanted = np.column_stack([joint.reference.at(time) for joint in control.joints.values()])
    rows = rows_of(prepared.inputs, prepared.dt)[: count * intervals].reshape(count, -1)
    given = [plant.parameters.values, np.zeros(1) if runner is None else runner.numbers]
    given += [Mechanism(rig).parameters.values, errors.numbers.ravel(), gains_of(control.joints).T.ravel()]
    given += [drive_numbers(plant.rig, prepared.dt).T.ravel(), np.array([period, control.co_contraction, encoder])]
    ys = advance(loop_kernel(shape), Feed(start, np.hstack([rows, draws[1:], wanted]), np.concatenate(given))).ys
    out = {name: shape.y.view(ys, name) for name in ("plant", "read", "asked", "angles", "stds")}
    motion = Motion(plant, np.vstack([begin, out["plant"]]))
    motion.check()
    told, unsure = np.vstack([angles, out["angles"][:-1]]), np.vstack([stds, out["stds"][:-1]])
    if not (np.isfinite(told).all() and np.all(unsure <= LOST)):
        return None
    return Scanned(Motion(plant, motion.y[:-1]), np.vstack([first, out["read"][:-1]]), told, unsure, out["asked"])


@lru_cache(maxsize=8)
def plant_kernel(plant: Mechanism, count: int) -> Kernel:
    """Return the plant's own kernel."""
    return Kernel(plant_function(plant, count))

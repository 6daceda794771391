"""`adaptive`: the filter that also estimates what is uncertain in the rig, and its belief before
the first sample, from the rig and from that sample's readings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.drive_tracking import (
    MEMORY,
    REMEMBERED,
    begun_alone,
    branches,
    either_variance,
)
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_function import adaptive_function, adaptive_layout
from distal.estimators.adaptive.filter_inputs import states_of_rig
from distal.estimators.adaptive.guard_settings import Robustness
from distal.estimators.adaptive.states import KINDS, Begin, Kind, StateVector
from distal.estimators.adaptive.touch import TORQUE, touch_layout
from distal.estimators.estimator_protocol import (
    UNKNOWN_POSITION,
    KernelEstimator,
    Report,
    channels_of,
    sensor_for,
)
from distal.estimators.kinematic import directions
from distal.expressions import Scalar, Vector
from distal.kernels import Compiled, Structure, kernel_of, structure_of
from distal.kernels.layout import is_read
from distal.logs import frozen
from distal.regression import (
    JudgedJumps,
    ReportedMap,
    Shape,
    begun_by,
    forces_parameters,
    homed_memory,
    map_function,
    map_parameters,
    reporting_function,
)
from distal.rig import LearnedMaps, Rig, Sensor

Read = Callable[[Sensor, Scalar], Scalar]
"""Function that returns a sensor's first value, or its second argument where that value
is missing.
"""


def _with_parameters(context: FilterContext, outputs: list[Vector], p: Vector) -> list[Vector]:
    """Return expressions with the first of the filter's inputs p in place of the parameters."""
    parameters = context.mechanism.parameters.symbols
    return list(ca.substitute(outputs, [parameters], [p[: parameters.numel()]]))


def _memory(context: FilterContext, read: Read, is_there: Callable[[Sensor], Scalar]) -> Vector:
    """Return what is remembered of the drives and their forces at the first sample; the position of
    a drive is unknown where `is_there` is 0.
    """
    memories = []
    for i, drive in enumerate(context.rig.drives):
        position = context.position_sensor(i)
        effort = context.force_sensor(i)
        memory = ca.SX.zeros(MEMORY)
        if position is not None:
            unknown = UNKNOWN_POSITION[drive.kind] ** 2
            memory = begun_alone(read(position, 0.0), is_there(position), unknown)
        if effort is not None:
            memory[REMEMBERED.index("effort")] = read(effort, 0.0)
        memories.append(memory)
    return ca.vertcat(*memories, ca.SX.zeros(sum(touch_layout(context).values())))


def _begin(context: FilterContext, read: Read) -> Begin:
    """Return the readings of the first sample; `read` gives a sensor's value, or its second
    argument where that is missing.
    """
    positions = [context.position_sensor(i) for i in range(context.n_drives)]
    forces = [context.force_sensor(i) for i in range(context.n_drives)]
    tendons = context.rig.tendon_names
    tensions = [sensor_for(context.channels.tensions, name) for name in tendons]
    starts, efforts, pulls = (
        [None if sensor is None else read(sensor, 0.0) for sensor in sensors]
        for sensors in (positions, forces, tensions)
    )
    return Begin([0.0 if start is None else start for start in starts], efforts, pulls)


@lru_cache(maxsize=32)
def state_vector(
    rig: Rig,
    references: tuple[Sensor, ...] = (),
    inputs: tuple[str, ...] = (),
    guards: Robustness | None = None,
    kinds: tuple[Kind, ...] = KINDS,
    folded: bool = False,
) -> StateVector:
    """Return the states of a filter.

    They are cached, since one rig estimates many logs and their functions take 0.1 s to build.

    Raises:
        EstimationError: the sensors do not suffice.
    """
    if guards is None:
        guards = Robustness.usual(len(rig.joints), rig.is_taught)
    channels = channels_of(rig, "adaptive", references)
    return states_of_rig(rig, inputs, channels, guards, kinds, folded)


class AdaptiveFilter(KernelEstimator):
    """A displacement-driven Kalman filter that estimates what is uncertain in the rig beside the
    joints' motion.

    Args:
        compiled: compile its kernel where possible, see `Kernel`.
        robustness: the guards against a wrong model and bad sensors; default `Robustness.usual`.
        name: of the estimator, for messages.
        references: sensors of joints' angles that are read too, while they are known (homing,
            fitting).
        inputs: parameters of the description that are inputs of its kernel and no states (fitting).
        resolution: largest product of sub-step and a joint's own frequency; default `RESOLUTION`,
            on a chain `CHAIN_RESOLUTION`.
        trace: let the kernel put out what a smoother needs.
        kinds: functions that give the states of a rig, one for each kind of state.
        folded: write all numbers but the equations' parameters into the kernel, for C second.
        home_std: where it is given, the references do not move the filter but condition its maps,
            see `homing_filter` [rad].

    Raises:
        EstimationError: the sensors do not suffice, or a map was learned from other sensors.
    """

    def __init__(
        self,
        rig: Rig,
        compiled: Compiled = True,
        robustness: Robustness | None = None,
        *,
        name: str = "adaptive",
        references: Sequence[Sensor] = (),
        inputs: Sequence[str] = (),
        resolution: float | None = None,
        trace: bool = False,
        kinds: Sequence[Kind] = KINDS,
        folded: bool = False,
        home_std: float | None = None,
    ) -> None:
        channels = channels_of(rig, name, references)
        self.states = state_vector(
            rig, tuple(references), tuple(inputs), robustness, tuple(kinds), folded
        )
        self._resolution = resolution
        self._home_std = home_std
        # a smoother goes back over the filter's own states
        self._take(LearnedMaps() if trace or rig.map is None else rig.map)
        self.structure = self._structure(trace)
        kernel = kernel_of(
            self.structure,
            lambda: self._reporting(adaptive_function(self.states, resolution, trace)),
            compiled,
        )
        parameters = self.states.context.mechanism.parameters.values
        parameters = np.concatenate([parameters, *self._map_parameters])
        measured = tuple(sensor.name for sensor in channels.compared)
        super().__init__(
            name,
            rig,
            kernel,
            parameters,
            channels=channels,
            state_names=self.states.names,
            measured=measured,
            bridged=len(channels.positions),
        )
        self.state_kinds = self.states.state_kinds
        self.state_parts = self.states.state_parts
        # maps on readings alone only share in the answer of those beside the filter
        answering = self._reported[: len(self.maps.filter)]
        self.report = Report.behind(
            2 * len(self.measured),
            [placed.states for placed in answering],
            [placed.learned.arrays["correlation"] for placed in answering],
        )

    def _take(self, maps: LearnedMaps) -> None:
        """Take maps: those beside the filter, and those that share in the angles, are reported."""
        channels = self.states.context.channels
        names = channels.names
        joints = self.states.context.rig.joint_names
        is_homed = self._home_std is not None
        homes = {sensor.of: names.index(sensor.name) for sensor in channels.angles}
        self.maps = maps
        self._reported = [
            ReportedMap(
                learned,
                tuple(map(names.index, learned.channels)),
                tuple(map(joints.index, learned.joints)),
                tuple(homes[joint] for joint in learned.joints) if is_homed else (),
            )
            for learned in (*maps.filter, *maps.pooled)
        ]
        # what forces say of jumps
        self._judges = JudgedJumps.among(maps.efforts if self._reported else (), names)
        of_maps = [map_parameters(placed.learned) for placed in self._reported]
        of_judges = [forces_parameters(judge.learned) for judge in self._judges]
        self._map_parameters = of_maps + of_judges

    def _reporting(self, function: ca.Function) -> ca.Function:
        """Return the filter with the values of its maps among its outputs."""
        if not self._reported:
            return function
        n = len(self.states.names)
        shares = tuple(self._of_torques("share"))
        variances = [n + i * (n + 1) for i in range(self.states.context.n_joints)]
        return reporting_function(
            function,
            self._reported,
            self.positions,
            variances,
            shares,
            self._tracked(function),
            self._judges,
            self._of_positions("evidence"),
        )

    def _tracked(self, function: ca.Function) -> ca.Function:
        """Return the function (kernel_state, p) → the positions of the drives as their sensors
        should read them, and their variances beyond noise; and whether each channel is believed.
        """
        context = self.states.context
        drives = context.rig.drive_names
        state, _, p = function.sx_in()
        columns = []
        either = dict[int, Scalar]()
        chance = ca.SX(0)
        believed = ca.SX.ones(len(context.channels.names))
        begin = self._of_positions(REMEMBERED[0])
        for k, (sensor, at) in enumerate(zip(context.channels.positions, begin)):
            branch = branches(state[at : at + MEMORY])
            offset = context.corrected(sensor, ca.SX(0))
            gain = context.corrected(sensor, ca.SX(1)) - offset
            placed = [(branch[name] - offset) / gain for name in ("off", "real")]
            columns.append((*placed, branch["variance"] / gain**2))
            believed[context.channels.of_message(k)] = branch["believed"]
            chance = ca.fmax(chance, branch["chance"])
            shift = branch["real"] - branch["off"]
            either[drives.index(sensor.of)] = either_variance(branch["chance"], shift)
        placed, second, variances = (ca.vertcat(*rows) for rows in zip(*columns))
        spreads = [
            sum(
                context.number(ratio) ** 2 * either.get(i, 0)
                for i, (ratio, _) in context.moved_by(joint).items()
            )
            for joint in context.mechanism.free
        ]
        of_joints = ca.mtimes(context.mechanism.spread**2, ca.vertcat(*spreads))  # (31)
        outputs = [placed, second, chance, variances, believed, of_joints]
        return ca.Function("tracked", [state, p], _with_parameters(context, outputs, p))

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance's diagonal, memory) before the
        first sample.

        Drives are at rest at the positions of the first sample; the effort that a play transmits is
        the first reading of its drive's effort. The angles are those of the maps on readings alone,
        where these are more certain than the rig.
        """
        states = self.states
        context = states.context
        inputs = self._first_sample()
        values, is_present, p = inputs
        x = ca.vertcat(0, values, is_present)

        def is_there(sensor: Sensor) -> Scalar:
            return is_read(context.mask(x, sensor))

        def read(sensor: Sensor, otherwise: Scalar) -> Scalar:
            return ca.if_else(is_there(sensor), context.value(x, sensor), otherwise)

        means, stds = states.prior()
        mean = ca.SX(means)
        variances = ca.SX(stds**2)
        memory = _memory(context, read, is_there)
        for i in range(context.n_drives):
            effort = context.force_sensor(i)
            at = states.transmitted(i)
            if at is not None and effort is not None:
                mean[at] = read(effort, mean[at])
        begin = _begin(context, read)
        for at, state in enumerate(states.states):
            if state.first is not None:
                mean[at], std = state.first(begin)
                variances[at] = std**2
        # maps beside the filter read the positions of drives as it has them, without a known offset
        placed = (context.value(x, sensor) for sensor in context.channels.positions)
        outputs = [mean, variances, memory, ca.vertcat(*placed, values[self.bridged :])]
        plain = ca.Function("plain", inputs, _with_parameters(context, outputs, p))
        return self._with_maps(plain)

    def _with_maps(self, plain: ca.Function) -> ca.Function:
        """Return the function `plain` with the start by maps, and with the memories of maps."""
        inputs = plain.mx_in()
        values, is_present, p = inputs
        mean, variances, memory, tracked = plain(*inputs)
        for learned in self.maps.readings:
            columns = [self.channels.index(name) for name in learned.channels]
            read = values[columns], is_present[columns]
            function = map_function(Shape.of(learned), len(learned.joints))
            begun = begun_by(learned, *read)
            of_map = map_parameters(learned)
            angles, _, spreads, _ = function(begun, 0, *read, of_map, 0, read[0], 0)
            for k, name in enumerate(learned.joints):
                joint = self.rig.joint_names.index(name)
                better = spreads[k] < variances[joint]
                mean[joint] = ca.if_else(better, angles[k], mean[joint])
                variances[joint] = ca.if_else(better, spreads[k], variances[joint])
        number = len(self.parameter_names)
        for placed in self._reported:
            columns = list(placed.channels)
            of = (tracked if placed.learned.beside_filter else values)[columns]
            if placed.learned.beside_filter:
                of = ca.vertcat(of, mean[list(placed.states)])
            begun = begun_by(placed.learned, of, is_present[columns])
            if placed.homes:
                of_map = p[number : number + placed.parameters]
                begun = homed_memory(placed.shape, placed.joints)(begun, of_map, self._home_std)
            memory = ca.vertcat(memory, begun)
            number += placed.parameters
        for judge in self._judges:
            at = list(judge.positions)
            memory = ca.vertcat(memory, judge.begun(values[at], is_present[at]))
        return ca.Function("prior", inputs, [mean, variances, memory])

    @cached_property
    def unseen(self) -> str | None:
        """A sentence on the directions of joint space that the sensors do not see; None where they
        see all, or the rig has one joint.
        """
        seen = directions(self.rig)
        return seen.text if len(seen.missed) and len(self.rig.joints) > 1 else None

    def with_maps(self, maps: LearnedMaps) -> AdaptiveFilter:
        """Return the same filter, kernel included, with other numbers in its maps."""
        changed = copy(self)
        changed._take(maps)
        parameters = self.parameters[: len(self.parameter_names)]
        changed._p = frozen(np.concatenate([parameters, *changed._map_parameters]))
        changed._begin = None
        return changed

    def folded(self) -> AdaptiveFilter:
        """Return the same filter with all numbers but the parameters of the equations written into
        its function, for C second.
        """
        context = self.states.context
        return AdaptiveFilter(
            self.rig,
            False,
            context.robustness,
            name=self.name,
            references=context.channels.angles,
            inputs=context.mechanism.parameters.inputs,
            resolution=self._resolution,
            kinds=self.states.kinds,
            folded=True,
            home_std=self._home_std,
        )

    def _structure(self, trace: bool) -> Structure | None:
        """Return what the kernel depends on; None, so that it is not shared, where numbers are
        folded into it or a kind of state comes from outside the package.
        """
        context = self.states.context
        if context.mechanism.parameters.folded or self.states.kinds != KINDS:
            return None
        lagging = [sensor.name for sensor in context.channels.positions if sensor.lag > 0.0]
        return structure_of(
            "filter",
            context.mechanism,
            channels=(context.channels.names, lagging),
            states=self.states.structure,
            friction_declared=tuple(map(context.declares_friction, range(context.n_drives))),
            joints_settle=context.joints_settle,
            sub_steps=self.substeps,
            guards=context.robustness,
            smoothing=trace,
            maps=tuple(
                (placed.learned.structure, placed.channels, placed.states, placed.homes)
                for placed in self._reported
            ),
            judges=tuple(
                (judge.learned.structure, judge.positions, judge.forces) for judge in self._judges
            ),
        )

    @property
    def positions(self) -> tuple[int | None, ...]:
        """Index in the kernel state of the drive's position, for each position channel; None for
        the channels of tensions and forces, whose readings are used as they are.
        """
        channels = self.states.context.channels
        read = [None] * (len(channels.tensions) + len(channels.forces))
        return (*self._of_positions("position"), *read)

    def _of_positions(self, part: str) -> list[int]:
        """Return the indices in the kernel state of a part of what is remembered of each drive with
        a position sensor, in the order of these sensors.
        """
        context = self.states.context
        drives = context.rig.drive_names
        begin = adaptive_layout(self.states)["drives"].start
        return [
            begin + MEMORY * drives.index(sensor.of) + REMEMBERED.index(part)
            for sensor in context.channels.positions
        ]

    def _of_torques(self, part: str) -> list[int]:
        """Return the indices in the kernel state of a part of what is remembered of each torque."""
        at = adaptive_layout(self.states)["torques"].start + TORQUE[part].start
        return [at + TORQUE.size * k for k in range(len(self.states.context.touchable))]

    @property
    def contacts(self) -> dict[str, list[int]]:
        """Joint → indices in the kernel state of the probability of a touch, and of the time for
        which it has lasted [s].
        """
        joints = (self.rig.joints[joint].name for joint in self.states.context.touchable)
        found = zip(self._of_torques("probability"), self._of_torques("since"))
        return {joint: list(indices) for joint, indices in zip(joints, found)}

    @property
    def substeps(self) -> int:
        """Number of sub-steps of the joints in one interval."""
        return self.states.context.substeps(self._resolution)

    @cached_property
    def priors(self) -> tuple[Floats, Floats]:
        """Prior means and stds of the states that are constants of the rig or of its sensors, NaN
        for the others, (n,) each.
        """
        states = self.states
        means, stds = np.where(states.lasting, (states.means, states.stds), np.nan)
        return frozen(means), frozen(stds)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the kernel's parameters, (n_p,)."""
        return self.states.context.mechanism.parameters.names

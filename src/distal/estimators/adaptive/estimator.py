"""The belief before the first sample, from the rig and from that sample's readings.

`adaptive`: the filter that also estimates what is uncertain in the rig.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.estimators.adaptive.drive_tracking import MEMORY, branches, remembered_position
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.filter_function import adaptive_function, adaptive_layout
from distal.estimators.adaptive.filter_inputs import states_of_rig
from distal.estimators.adaptive.guards import Robustness
from distal.estimators.adaptive.states import KINDS, Begin, Kind, StateVector
from distal.estimators.adaptive.touch import TORQUE, touch_layout
from distal.estimators.estimator_protocol import (
    UNKNOWN_POSITION,
    KernelEstimator,
    Report,
    channels_of,
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
from distal.rig import LearnedMap, LearnedMaps, Rig, Sensor

Read = Callable[[Sensor, Scalar], Scalar]
"""Function that returns a sensor's first value, or its second argument where that value
is missing.
"""


def prior_function(
    states: StateVector,
    maps: Sequence[ReportedMap],
    judges: Sequence[JudgedJumps],
    readings: Sequence[tuple[LearnedMap, Sequence[int]]],
    positions: Sequence[int | None],
    inputs: int,
    home_std: float | None = None,
) -> ca.Function:
    """Return the function (values, mask, p) → (mean, covariance's diagonal, memory) before the
    first sample.

    Drives are at rest at the positions of the first sample; the effort that a play transmits is the
    first reading of its drive's effort.

    The angles are those of the maps on readings alone, where these are more certain than the rig.

    Args:
        maps: each map that is reported.
        readings: each map on readings alone, with the joints that it speaks of.
        positions: for each channel the index in the kernel state of its drive's position, None for
            readings used as they are.
        inputs: length of p.
        home_std: std of the angles at which joints are known to stand [rad], if they ever are.
    """
    context = states.context
    names = context.channels.names
    values = ca.SX.sym("values", len(names))
    is_present = ca.SX.sym("mask", len(names))
    sensors = {sensor.name: sensor for sensor in context.mechanism.rig.sensors}
    credible = (context.credible(sensors[name], values[k]) for k, name in enumerate(names))
    mask = ca.vertcat(*(is_present[k] * is_credible for k, is_credible in enumerate(credible)))

    def is_there(sensor: Sensor) -> Scalar:
        return is_read(mask[names.index(sensor.name)])

    def read(sensor: Sensor, otherwise: Scalar) -> Scalar:
        value = context.corrected(sensor, values[names.index(sensor.name)])
        return ca.if_else(is_there(sensor), value, otherwise)

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
    placed = (
        values[k] if at is None else context.corrected(sensors[names[k]], values[k])
        for k, at in enumerate(positions)
    )
    symbols = context.mechanism.parameters.symbols
    p = ca.SX.sym("p", inputs)
    outputs = [mean, variances, memory, ca.vertcat(*placed, values[len(positions) :])]
    outputs = ca.substitute(outputs, [symbols], [p[: symbols.numel()]])
    plain = ca.Function("plain", [values, is_present, p], outputs)
    return _with_maps(plain, maps, judges, readings, names, home_std)


def _with_maps(
    plain: ca.Function,
    maps: Sequence[ReportedMap],
    judges: Sequence[JudgedJumps],
    readings: Sequence[tuple[LearnedMap, Sequence[int]]],
    names: Sequence[str],
    home_std: float | None,
) -> ca.Function:
    """Return the function `plain` with the start by maps, and with the memories of maps."""
    values, is_present, p = (ca.MX.sym(n, plain.numel_in(i)) for i, n in enumerate("vmp"))
    mean, variances, memory, tracked = plain(values, is_present, p)
    for learned, joints in readings:
        columns = [list(names).index(name) for name in learned.channels]
        read = values[columns], is_present[columns]
        function = map_function(Shape.of(learned), len(learned.joints))
        begun = begun_by(learned, *read)
        angles, _, spreads, _ = function(begun, 0, *read, map_parameters(learned), 0, read[0], 0)
        for k, joint in enumerate(joints):
            better = spreads[k] < variances[joint]
            mean[joint] = ca.if_else(better, angles[k], mean[joint])
            variances[joint] = ca.if_else(better, spreads[k], variances[joint])
    sizes_of_p = [*(placed.parameters for placed in maps), *(judge.parameters for judge in judges)]
    number = p.numel() - sum(sizes_of_p)
    for placed in maps:
        columns = list(placed.channels)
        of = (tracked if placed.learned.beside_filter else values)[columns]
        if placed.learned.beside_filter:
            of = ca.vertcat(of, mean[list(placed.states)])
        begun = begun_by(placed.learned, of, is_present[columns])
        if placed.homes:
            parameters = p[number : number + placed.parameters]
            begun = homed_memory(placed.shape, placed.joints)(begun, parameters, home_std)
        memory = ca.vertcat(memory, begun)
        number += placed.parameters
    for judge in judges:
        at = list(judge.positions)
        memory = ca.vertcat(memory, judge.begun(values[at], is_present[at]))
    return ca.Function("prior", [values, is_present, p], [mean, variances, memory])


def _memory(context: FilterContext, read: Read, is_there: Callable[[Sensor], Scalar]) -> Vector:
    """Return what is remembered of the drives and their forces at the first sample; the position of
    a drive is unknown where `is_there` is 0.
    """
    lengths = touch_layout(context)
    memory = ca.SX.zeros(MEMORY * context.n_drives)
    for i, drive in enumerate(context.mechanism.rig.drives):
        position = context.position_sensor(i)
        effort = context.force_sensor(i)
        if position is not None:
            unknown = UNKNOWN_POSITION[drive.kind] ** 2
            memory[remembered_position(i, "position")] = read(position, 0.0)
            memory[remembered_position(i, "real")] = 1
            memory[remembered_position(i, "unknown")] = ca.if_else(is_there(position), 0.0, unknown)
        if effort is not None:
            memory[remembered_position(i, "effort")] = read(effort, 0.0)
    forces, evidence, torques = (
        ca.SX.zeros(lengths[name]) for name in ("forces", "evidence", "torques")
    )
    return ca.vertcat(memory, forces, evidence, torques)


def _begin(context: FilterContext, read: Read) -> Begin:
    """Return the readings of the first sample; `read` gives a sensor's value, or its second
    argument where that is missing.
    """
    cells = {sensor.of: sensor for sensor in context.channels.tensions}
    positions = [context.position_sensor(i) for i in range(context.n_drives)]
    forces = [context.force_sensor(i) for i in range(context.n_drives)]
    tensions = [cells.get(name) for name in context.mechanism.rig.tendon_names]
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
        self.state_kinds = self.states.state_kinds
        self.state_parts = self.states.state_parts
        self._resolution = resolution
        self._home_std = home_std
        # a smoother goes back over the filter's own states
        self.maps = LearnedMaps() if trace or rig.map is None else rig.map
        self.structure = self._structure(trace)
        kernel = kernel_of(
            self.structure,
            lambda: self._reporting(adaptive_function(self.states, resolution, trace)),
            compiled,
        )
        parameters = self.states.context.mechanism.parameters.values
        parameters = np.concatenate([parameters, *self._map_parameters()])
        measured = tuple(sensor.name for sensor in channels.compared)
        super().__init__(
            name,
            rig,
            kernel,
            parameters,
            channels=channels,
            state_names=self.states.names,
            measured=measured,
        )
        # maps on readings alone only share in the answer of those beside the filter
        answering = self._reported[: len(self.maps.filter)]
        self.report = Report.behind(
            2 * len(self.measured),
            [placed.states for placed in answering],
            [placed.learned.arrays["correlation"] for placed in answering],
        )

    @property
    def _reporting_maps(self) -> tuple[LearnedMap, ...]:
        """Those beside the filter, and those that share in the angles."""
        return (*self.maps.filter, *self.maps.pooled)

    def _map_parameters(self) -> list[Floats]:
        """Return the parameters of its maps."""
        judges = (forces_parameters(judge.learned) for judge in self._judges)
        return [*map(map_parameters, self._reporting_maps), *judges]

    @property
    def _reported(self) -> list[ReportedMap]:
        """Each map that is reported."""
        context = self.states.context
        names = context.channels.names
        joints = context.mechanism.rig.joint_names
        homes = {sensor.of: names.index(sensor.name) for sensor in context.channels.angles}
        reported = []
        for learned in self._reporting_maps:
            channels = tuple(names.index(channel) for channel in learned.channels)
            states = tuple(joints.index(joint) for joint in learned.joints)
            is_homed = self._home_std is not None
            given = tuple(homes[joint] for joint in learned.joints) if is_homed else ()
            reported.append(ReportedMap(learned, channels, states, given))
        return reported

    def _reporting(self, function: ca.Function) -> ca.Function:
        """Return the filter with the values of its maps among its outputs."""
        if not self._reporting_maps:
            return function
        n = len(self.states.names)
        shares = tuple(self._of_torques("share"))
        variances = [n + i * (n + 1) for i in range(self.states.context.n_joints)]
        begin = adaptive_layout(self.states)["drives"].start
        drives = self.states.context.mechanism.rig.drive_names
        evidence = [
            begin + remembered_position(drives.index(sensor.of), "evidence")
            for sensor in self.states.context.channels.positions
        ]
        return reporting_function(
            function,
            self._reported,
            self.positions,
            variances,
            shares,
            self._tracked(function),
            self._judges,
            evidence,
        )

    @property
    def _judges(self) -> list[JudgedJumps]:
        """What forces say of jumps."""
        names = self.states.context.channels.names
        return JudgedJumps.among(self.maps.efforts if self._reporting_maps else (), names)

    def _tracked(self, function: ca.Function) -> ca.Function:
        """Return the function (kernel_state, p) → the positions of the drives as their sensors
        should read them, and their variances beyond noise; and whether each channel is believed.
        """
        context = self.states.context
        drives = context.mechanism.rig.drive_names
        begin = adaptive_layout(self.states)["drives"].start
        state, p = (ca.SX.sym(name, function.size1_in(k)) for name, k in (("state", 0), ("p", 2)))
        columns = []
        either = dict[int, Scalar]()
        chance = ca.SX(0)
        believed = ca.SX.ones(len(context.channels.names))
        for k, sensor in enumerate(context.channels.positions):
            at = begin + MEMORY * drives.index(sensor.of)
            branch = branches(state[at : at + MEMORY])
            offset = context.corrected(sensor, ca.SX(0))
            gain = context.corrected(sensor, ca.SX(1)) - offset
            placed = [(branch[name] - offset) / gain for name in ("off", "real")]
            columns.append((*placed, branch["variance"] / gain**2))
            believed[context.channels.of_message(k)] = branch["believed"]
            chance = ca.fmax(chance, branch["chance"])
            either[drives.index(sensor.of)] = (
                branch["chance"] * (1 - branch["chance"]) * (branch["real"] - branch["off"]) ** 2
            )
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
        symbols = context.mechanism.parameters.symbols
        outputs = ca.substitute(outputs, [symbols], [p[: symbols.numel()]])
        return ca.Function("tracked", [state, p], outputs)

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance's diagonal, memory) before the
        first sample.
        """
        joints = self.rig.joint_names
        readings = [
            (learned, [joints.index(joint) for joint in learned.joints])
            for learned in self.maps.readings
        ]
        return prior_function(
            self.states,
            self._reported,
            self._judges,
            readings,
            self.positions,
            len(self._p),
            self._home_std,
        )

    def notes_of(self, means: Floats, samples: Floats) -> tuple[str, ...]:
        """Return a sentence on the directions of joint space that the sensors do not see, if there
        are any.
        """
        return () if self.unseen is None else (self.unseen,)

    @cached_property
    def unseen(self) -> str | None:
        """A sentence on the directions of joint space that the sensors do not see; None where they
        see all, or the rig has one joint.
        """
        seen = directions(self.rig)
        return seen.text if len(seen.missed) and len(self.rig.joints) > 1 else None

    @property
    def bridged(self) -> int:
        """Number of displacements, which are the first channels and are interpolated along a
        straight line over a gap.
        """
        return len(self.states.context.channels.positions)

    def with_maps(self, maps: LearnedMaps) -> AdaptiveFilter:
        """Return the same filter, kernel included, with other numbers in its maps."""
        changed = copy(self)
        changed.maps = maps
        parameters = self.parameters[: len(self.parameter_names)]
        changed._p = frozen(np.concatenate([parameters, *changed._map_parameters()]))
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
        context = self.states.context
        channels = context.channels
        drives = context.mechanism.rig.drive_names
        begin = adaptive_layout(self.states)["drives"].start
        placed = [
            begin + remembered_position(drives.index(sensor.of), "position")
            for sensor in channels.positions
        ]
        return (*placed, *([None] * (len(channels.tensions) + len(channels.forces))))

    @property
    def touched(self) -> tuple[int, ...]:
        """Indices in the kernel state of the probability that something touches a joint, of each
        joint that may be touched.
        """
        return tuple(self._of_torques("probability"))

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

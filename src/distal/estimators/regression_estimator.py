"""`regression`, the estimator without a model of the rig: the angles by a map of what the sensors
read and remember, which logs or a homing move have taught.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import casadi as ca
import numpy as np

from distal.errors import EstimationError
from distal.estimators.adaptive.drive_tracking import MEMORY, begun_alone, judged_alone
from distal.estimators.adaptive.filter_inputs import JUDGED, judged_by
from distal.estimators.estimator_protocol import (
    UNKNOWN_POSITION,
    Channels,
    KernelEstimator,
    channels_of,
)
from distal.expressions import VectorNode, symbols
from distal.kernels import Kernel, Layout, kernel_state_layout
from distal.kernels.layout import is_read
from distal.logs import Log, TruthKind, frozen, true_angles
from distal.machine_limits import one_blas_thread
from distal.regression import (
    JudgedJumps,
    Samples,
    Shape,
    begun_by,
    forces_parameters,
    from_window,
    given,
    map_function,
    map_layout,
    map_parameters,
)
from distal.rig import LearnedMap, Rig, angle_names, independent_parts

NAME = "regression"

NEEDS = (
    "needs [map] in the rig file (distal fit with logs whose angle is known), or a homing move "
    "(--homing 3s)"
)
"""The words of a message on what to do where there is no map."""


def parts_of(rig: Rig, channels: Channels) -> list[dict[str, tuple[str, ...]]]:
    """Return for each independent part of a rig the fields of a `LearnedMap` that say what it
    speaks of and reads.
    """
    positions = {sensor.name for sensor in channels.positions}
    parts = []
    for part in independent_parts(rig):
        names = set(part.rig.sensor_names)
        read = tuple(sensor.name for sensor in channels.proximal if sensor.name in names)
        parts.append(
            {
                "joints": tuple(part.rig.joint_names),
                "channels": read,
                "positions": tuple(name for name in read if name in positions),
            }
        )
    return parts


def samples_of_angles(log: Log, rig: Rig) -> Samples:
    """Return the samples of a log for maps on readings alone, with the true angles of the joints as
    targets, NaN where they are not known.

    Raises:
        EstimationError: a sensor is not in the log or has no value.
    """
    names = [sensor.name for sensor in channels_of(rig, NAME).proximal]
    for name in names:
        if name not in log.channels or not np.isfinite(log.channels[name]).any():
            raise EstimationError(
                f"{log.source}: regression needs the sensor '{name}', which has no value in this "
                "log"
            )
    readings = np.column_stack([log.channels[name] for name in names])
    truth = true_angles(log, rig.joint_names)
    angles = np.full((len(log), len(rig.joints)), np.nan) if truth is None else truth
    return Samples.of_readings(log, readings, angles)


def of_part(
    samples: Samples,
    rig: Rig,
    names: Sequence[str],
    joints: Sequence[str],
    channels: Sequence[str],
) -> Samples:
    """Return the samples of the joints and sensors of a part; `names` are those of all sensors."""
    rows = [rig.joint_names.index(joint) for joint in joints]
    columns = [names.index(channel) for channel in channels]
    angles = samples.angles[:, rows] if samples.angles.shape[1] else samples.angles
    return replace(
        samples,
        readings=samples.readings[:, columns],
        angles=angles,
        targets=samples.targets[:, rows],
        variances=samples.variances[:, rows],
    )


def offsets_of(log: Log, rig: Rig) -> dict[str, float]:
    """Return joint → std of the angle at which the log says that it stood [rad]; none for an
    encoder, whose zero is what a map's angles are compared with.
    """
    if log.truth_kind is not TruthKind.HOME:
        return {}
    return {sensor.of: sensor.bias.filter_std for sensor in reversed(rig.sensors_of("angle"))}


class RegressionEstimator(KernelEstimator):
    """The estimator that reports the angles of the maps `Rig.map.readings`, see `map_function`.

    With `homing` the rig needs none, since `after_homing` will give them.

    Raises:
        EstimationError: there is no map.
    """

    def __init__(self, rig: Rig, compiled: bool = True, homing: bool = False) -> None:
        channels = channels_of(rig, NAME)
        maps = () if rig.map is None else rig.map.readings
        if not maps and not homing:
            raise EstimationError(
                f"regression: '{rig.name}' has no map of what its sensors read; it {NEEDS}"
            )
        self._compiled = compiled
        names = angle_names(rig.joint_names)
        super().__init__(
            NAME,
            rig,
            None,
            np.zeros(0),
            channels=channels,
            state_names=names,
            bridged=len(channels.positions),
        )
        self._sensors = channels
        if maps:
            self._learn(maps)

    def _learn(self, maps: Sequence[LearnedMap]) -> None:
        """Take maps, with a new kernel where there is none yet."""
        self.maps = tuple(maps)
        of_maps = [map_parameters(learned) for learned in maps]
        described = self.rig.with_map(readings=maps)
        of_positions = [judged_by(described, sensor) for sensor in self._sensors.positions]
        efforts = () if self.rig.map is None else self.rig.map.efforts
        self._judges = JudgedJumps.among(efforts, self.channels)
        of_judges = [forces_parameters(judge.learned) for judge in self._judges]
        self._p = frozen(np.concatenate([*of_maps, *of_positions, *of_judges]))
        self._begin = None
        if self._kernel is None:
            self._kernel = Kernel(self._function(), self._compiled)

    @one_blas_thread()
    def after_homing(self, log: Log, homing: float) -> RegressionEstimator:
        """Return the estimator with maps that the first `homing` s of a log teach.

        The rig's own maps are conditioned on them; a rig without any begins with the prior.

        Raises:
            EstimationError: no joint's angle is known in these seconds; or no drive moves in them
                and the rig has no map.
        """
        samples = samples_of_angles(log, self.rig)
        early = samples.time < homing
        if not np.isfinite(samples.targets[early]).any():
            raise EstimationError(
                f"{log.source}: in the first {homing:g} s there are no samples with the "
                "reference, which regression needs; home for longer"
            )
        moves = np.ptp(samples.held[early, : self.bridged], axis=0) > 0.0
        if self._kernel is None and self.bridged and not moves.any():
            raise EstimationError(
                f"{log.source}: in the first {homing:g} s no drive moves, and regression learns "
                "there what the joint does with it; home with a move, or take the estimator "
                "adaptive"
            )
        offsets = offsets_of(log, self.rig)

        def samples_of(joints: Sequence[str], channels: Sequence[str]) -> Samples:
            return of_part(samples, self.rig, self.channels, joints, channels)

        if self._kernel is not None:
            after = [
                given(learned, samples_of(learned.joints, learned.channels), early, offsets)
                for learned in self.maps
            ]
        else:
            after = [
                from_window(samples_of(part["joints"], part["channels"]), part, early, offsets)
                for part in parts_of(self.rig, self._sensors)
            ]
        taught = copy(self)
        taught._learn(after)
        return taught

    def _function(self) -> ca.Function:
        """Return the function (kernel_state, x, p) → (kernel_state⁺, y). A position is as the
        filter's `track_function` believes it; where it is in doubt, all that its motor reads is
        missing.
        """
        n = len(self.state_names)
        shapes = [Shape.of(learned) for learned in self.maps]
        of_maps = [map_layout(shape, len(m.joints)) for shape, m in zip(shapes, self.maps)]
        layout = kernel_state_layout(
            n,
            **{f"map_{k}": shape.memory.size for k, shape in enumerate(shapes)},
            drives=MEMORY * self.bridged,
            judges=sum(judge.memory.size for judge in self._judges),
        )
        of = Layout(
            **{f"map_{k}": of_map.size for k, of_map in enumerate(of_maps)},
            drives=JUDGED.size * self.bridged,
            judges=sum(judge.parameters for judge in self._judges),
        )
        inputs = symbols(ca.MX, kernel_state=layout.size, x=self._sensors.row.size, p=of.size)
        kernel_state, x, p = inputs
        dt, readings, masks = self._sensors.row.parts(x).values()
        *of_map_p, judged_by_p, of_judges = of.parts(p).values()
        positions = [
            (k, judged_by_this, self._sensors.of_message(k))
            for k, judged_by_this in enumerate(ca.vertsplit(judged_by_p, JUDGED.size))
        ]
        drives, judged = (kernel_state[layout[name]] for name in ("drives", "judges"))
        sample = judged_alone(
            drives, dt, readings, masks, positions, self._judges, judged, of_judges
        )
        mean = ca.MX.zeros(n)
        spread = ca.MX.zeros(n, n)
        after = dict[str, VectorNode]()
        maps = zip(self.maps, shapes, of_maps, of_map_p)
        for k, (learned, shape, of_map, parameters) in enumerate(maps):
            columns = [self.channels.index(name) for name in learned.channels]
            rows = [self.rig.joint_names.index(joint) for joint in learned.joints]
            values, _, variances, after[f"map_{k}"] = map_function(shape, len(rows))(
                layout.part(kernel_state, f"map_{k}"),
                dt,
                sample.off[columns],
                sample.masks[columns],
                parameters,
                sample.doubts[columns],
                sample.real[columns],
                sample.chance,
            )
            stds = ca.sqrt(variances)
            mean[rows] = values
            spread[rows, rows] = of_map.part(parameters, "correlation") * ca.mtimes(stds, stds.T)
        following = layout.joined(
            mean=mean,
            covariance=spread,
            **after,
            drives=sample.drives,
            judges=sample.judges,
        )
        return ca.Function("regression", inputs, [following, ca.MX.zeros(1)])

    def prior_function(self) -> ca.Function:
        """Return the function (values, mask, p) → (mean, covariance's diagonal, memory) before the
        first sample.

        Raises:
            EstimationError: there is no map yet.
        """
        if self._kernel is None:
            raise EstimationError(
                f"regression: '{self.rig.name}' has no map before its homing move; it {NEEDS}"
            )
        inputs = self._first_sample()
        values, mask, _ = inputs
        joints = self.rig.joints
        mean = ca.SX(ca.DM([joint.initial.value for joint in joints]))
        spread = ca.SX(ca.DM([joint.initial.std**2 for joint in joints]))
        memories = []
        for learned in self.maps:
            columns = [self.channels.index(channel) for channel in learned.channels]
            memories.append(begun_by(learned, values[columns], mask[columns]))
        memories += [
            begun_alone(
                values[k], is_read(mask[k]), UNKNOWN_POSITION[self.rig.drive(sensor.of).kind] ** 2
            )
            for k, sensor in enumerate(self._sensors.positions)
        ]
        for judge in self._judges:
            at = list(judge.positions)
            memories.append(judge.begun(values[at], mask[at]))
        return ca.Function("prior", inputs, [mean, spread, ca.vertcat(*memories)])

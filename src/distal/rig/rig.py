"""The description of a whole rig: joints, drives, tendons, sensors, and the format of its logs; how
a force on a link turns the joints of a chain together; and its independent subsystems, which
move without one another, such as the fingers of a hand.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from scipy.sparse.csgraph import connected_components

from distal.arrays import Floats
from distal.errors import RigError, UnitError, did_you_mean
from distal.rig.components import BASE, Base, Drive, Joint, Tendon
from distal.rig.learned import KINDS, LearnedMap, LearnedMaps, LeftOut
from distal.rig.sensors import Sensor, in_its_unit, log_factor, measurand_of, part_of
from distal.rig.validation import named, set_value, validated
from distal.rig.values_with_stds import Description, Duration, Parameter, Rate
from distal.units import unit_factor

Component = Joint | Drive | Tendon | Sensor

MOST_JOINTS = 32
"""Largest number of joints of a rig [1]; the cost grows with the square of their number. Source:
judgement.
"""


class TimeColumn(Description):
    """Where a log holds time."""

    column: str = Field("t", min_length=1)
    unit: str = Field("s", min_length=1)
    repeated: Literal["refused", "first", "last", "spread"] = Field(
        "refused",
        description='"first" or "last" of rows with one stamp is kept, or they are "spread" evenly '
        'up to the next stamp, or such a log is "refused"',
    )
    rate: Rate | None = Field(None, description="of the rows, where no column holds their time")


class LogFormat(Description):
    """How the rig's logs are written; sensors name their own columns."""

    time: TimeColumn = TimeColumn()


class Stepping(Description):
    """Time step of the model."""

    largest_step: Duration | None = Field(
        None, description="of the full model; from the stiffest mode by default"
    )


class Rig(Description):
    """A tendon-driven rig: what there is, how well it is known, what is measured.

    Raises:
        RigError: from `distal.rig.load_rig` and `Rig.with_values`, where a description is wrong.
    """

    name: str = Field(min_length=1, description="title of plots and reports")
    log: LogFormat = LogFormat()
    base: Base = Base()
    joints: tuple[Joint, ...] = Field(
        min_length=1, max_length=MOST_JOINTS, description="from the base outwards"
    )
    drives: tuple[Drive, ...] = Field(min_length=1)
    tendons: tuple[Tendon, ...] = Field(min_length=1)
    sensors: tuple[Annotated[Sensor, BeforeValidator(in_its_unit)], ...] = ()
    stepping: Stepping = Stepping()
    when_lost: Literal["hold", "relax"] = Field(
        "hold",
        description='what motors do without readings for a second: "hold" (as much as they may '
        'hold for hours) or "relax"',
    )
    taken: tuple[Literal["length", "force"], ...] = Field(
        (),
        description='"length", "force": scales that were assumed, as no log tells them',
    )
    map: LearnedMaps | None = None
    left_out: LeftOut | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        unit_factor(self.log.time.unit, "s")
        for kind, components in self.components.items():
            _check_names(kind, [component.name for component in components])
        for i, joint in enumerate(self.joints):
            _check_position(i, joint, self.joint_names[:i])
            _check_coupling(i, joint, self.joints[:i])
        _check_tendons(self)
        _check_columns(self)
        _check_maps(self)
        _share_alike(self)
        _plays_apart(self)
        for i, joint in enumerate(self.joints):
            if joint.friction is None or self.reference_load(i) > 0.0:
                continue
            exponent = joint.friction.exponent
            if (exponent.value, exponent.filter_std) != (1.0, 0.0):
                raise ValueError(
                    f"joints.{i}.friction: an exponent other than 1 needs a 'reference' load "
                    "(or a preload, a pretension or a nominal_force to take it from)"
                )
        return self

    def reference_load(self, joint: int) -> float:
        """Return the load N_ref of a joint's friction [N]: the given `reference`, else preload +
        pretensions of its tendons + nominal forces of the sliders that pull them.
        """
        friction = self.joints[joint].friction
        if friction is not None and friction.reference is not None:
            return friction.reference
        load = friction.preload.value if friction is not None else 0.0
        tendons = [t for t in self.tendons if self.joints[joint].name in t.joints]
        pulls = {t.drive for t in tendons}
        load += sum(t.home_tension for t in tendons)
        return load + sum(
            abs(d.nominal_force.value)
            for d in self.drives
            if d.name in pulls and d.kind == "slider"
        )

    @property
    def is_chain(self) -> bool:
        """Whether the joints of the rig move one another: one has a link, or is coupled
        to another.
        """
        return any(joint.link is not None or joint.coupled is not None for joint in self.joints)

    def parent_of(self, joint: int) -> int | None:
        """Return the index of the joint on whose link a joint sits, None where it sits on
        the base.
        """
        name = self.joints[joint].parent
        if name is None:
            return joint - 1 if joint > 0 else None
        return None if name == BASE else self.joint_names.index(name)

    def sharing(self) -> dict[str, dict[str, float]]:
        """Return the shared errors, name → path of each parameter that has it → its std as a share
        of the value.
        """
        stds: dict[str, dict[str, float]] = {}
        for path, parameter in parameters_below(self):
            shared = parameter.shared
            if shared is not None and shared.std > 0.0 and not path.startswith("sensors."):
                stds.setdefault(shared.name, {})[path] = shared.std
        return stds

    def __repr__(self) -> str:
        """Return what it is in a few words; `model_dump` has all of it."""
        learned = [kind for kind in KINDS if self.map is not None and getattr(self.map, kind)]
        return f"Rig '{self.name}': {self.count_in_words()}" + (
            f"; learned maps: {', '.join(learned)}" if learned else ""
        )

    __str__ = __repr__

    def count_in_words(self) -> str:
        """Return how many components of each kind there are, in words."""
        counts = ((len(components), kind) for kind, components in self.components.items())
        return ", ".join(f"{n} {kind if n != 1 else kind[:-1]}" for n, kind in counts)

    @property
    def is_taught(self) -> bool:
        """Whether logs taught what forces are normal in free motion."""
        return self.map is not None and bool(self.map.efforts)

    def bare(self) -> Rig:
        """Return a copy without what was learned from logs (`map`, `left_out`)."""
        return self.model_copy(update={"map": None, "left_out": None})

    def with_map(self, **kinds: Sequence[LearnedMap]) -> Rig:
        """Return a copy with the maps of some kinds replaced, as in `LearnedMaps`."""
        before = LearnedMaps() if self.map is None else self.map
        changed = before.model_copy(update={kind: tuple(maps) for kind, maps in kinds.items()})
        return self.model_copy(update={"map": changed if changed.named() else None})

    @property
    def components(self) -> dict[str, tuple[Component, ...]]:
        """Kind, as a rig file names its lists → the components of this kind."""
        return {
            "joints": self.joints,
            "drives": self.drives,
            "tendons": self.tendons,
            "sensors": self.sensors,
        }

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, in their order."""
        return [joint.name for joint in self.joints]

    @property
    def drive_names(self) -> list[str]:
        """Names of the drives, in their order."""
        return [drive.name for drive in self.drives]

    @property
    def tendon_names(self) -> list[str]:
        """Names of the tendons, in their order."""
        return [tendon.name for tendon in self.tendons]

    @property
    def sensor_names(self) -> list[str]:
        """Names of the sensors, in their order."""
        return [sensor.name for sensor in self.sensors]

    def drive(self, name: str) -> Drive:
        """Return the drive of a name."""
        return self.drives[self.drive_names.index(name)]

    def tendons_of(self, drive: str) -> tuple[Tendon, ...]:
        """Return the tendons that a drive pulls, in their order."""
        return tuple(tendon for tendon in self.tendons if tendon.drive == drive)

    def sensors_of(self, measures: str) -> tuple[Sensor, ...]:
        """Return the sensors that measure `measures` (position, force, tension, angle or torque),
        in their order.
        """
        return tuple(sensor for sensor in self.sensors if sensor.measures == measures)

    def with_values(self, values: Mapping[str, object]) -> Rig:
        """Return a copy with some values replaced, named by path as with ``--set`` on the command
        line.

        Args:
            values: path → value, e.g. ``{"joints.finger.inertia": 1e-4, "drives.left.stops": ["-5
                mm", "15 mm"]}``. A bare number (or text) replaces a parameter's value and keeps its
                std.

        Raises:
            RigError: a path does not exist, or the new description is wrong.
        """
        if not isinstance(values, Mapping) or not all(isinstance(path, str) for path in values):
            raise RigError(f"with_values takes a mapping from path to value, {values!r} came")
        raw = self.bare().model_dump(mode="json") | {"map": self.map, "left_out": self.left_out}
        for path, value in values.items():
            set_value(raw, path, value, RigError)
        return validated(Rig, raw, self.name, RigError)


def _look_up(name: str, names: Sequence[str], path: str, kind: str) -> None:
    """Refuse a name, at a `path` in the description, that none of a kind of parts has."""
    if name not in names:
        raise ValueError(f"{path}: no {kind} is called '{name}'{did_you_mean(name, names)}")


def _check_names(kind: str, names: Sequence[str]) -> None:
    _distinct(names, f"{kind}: the name")
    for name in names:
        # states are written as theta_NAME, position_NAME and, with _std behind it, their standard
        # deviations
        if name in ("std", "dot") or name.endswith("_std"):
            raise ValueError(
                f"{kind}: the name '{name}' would be mistaken for a column of an estimate; choose "
                "another"
            )


def _check_position(index: int, joint: Joint, before: Sequence[str]) -> None:
    """Raise an error for a joint without its parent, or with keys that its position does not
    allow.
    """
    at = f"joints.{index}"
    if joint.name == BASE:
        raise ValueError(f"{at}.name: '{BASE}' is what the first joint sits on; choose another")
    if joint.parent is not None:
        _look_up(joint.parent, [BASE, *before], f"{at}.parent", "joint before it")
    if joint.gravity is None:
        return
    if joint.link is not None:
        raise ValueError(f"{at}.gravity: the link's mass and centre say it already; leave out one")
    if before and joint.parent != BASE:
        raise ValueError(
            f'{at}.gravity: is for a joint on the base (parent = "{BASE}"); on a chain give its '
            "'link' mass and centre"
        )


def _check_coupling(index: int, joint: Joint, before: Sequence[Joint]) -> None:
    """Refuse a coupling to nothing, and what a coupled joint cannot have."""
    if joint.coupled is None:
        return
    leader = joint.coupled.joint
    free = [preceding.name for preceding in before if preceding.coupled is None]
    _look_up(leader, free, f"joints.{index}.coupled.joint", "free joint before it")
    if joint.coupled.ratio == 0.0:
        raise ValueError(f"joints.{index}.coupled.ratio: must not be zero")
    for name in ("stops", "backlash", "external_torque", "initial"):
        if getattr(joint, name) != Joint.model_fields[name].default:
            raise ValueError(
                f"joints.{index}.{name}: is not supported on a coupled joint; give it to '{leader}'"
            )


def _check_tendons(rig: Rig) -> None:
    """Refuse tendons without their joints and drive, and joints and drives without a tendon."""
    for i, tendon in enumerate(rig.tendons):
        for name in tendon.joints:
            _look_up(name, rig.joint_names, f"tendons.{i}.joint", "joint")
        _look_up(tendon.drive, rig.drive_names, f"tendons.{i}.drive", "drive")
    for drive in rig.drives:
        if not rig.tendons_of(drive.name):
            raise ValueError(
                f"drives: '{drive.name}' pulls no tendon; remove it or name it in a tendon's "
                "'drive'"
            )
    crossed = {name for tendon in rig.tendons for name in tendon.joints}
    crossed |= {
        joint.coupled.joint
        for joint in rig.joints
        if joint.coupled is not None and joint.name in crossed
    }
    for joint in rig.joints:
        if joint.name not in crossed and joint.coupled is None:
            raise ValueError(
                f"joints: no tendon crosses '{joint.name}', so nothing tells where it is; name it "
                "in a tendon, or give 'coupled'"
            )


def _check_columns(rig: Rig) -> None:
    """Refuse units of the log that are not those of its columns, and columns of two meanings."""
    for i, sensor in enumerate(rig.sensors):
        try:
            log_factor(sensor)
        except UnitError as error:
            raise ValueError(f"sensors.{i}.unit: {error}") from None
        if sensor.log_column.startswith("true_"):
            raise ValueError(
                f"sensors: the log column '{sensor.log_column}' begins with 'true_', which is kept "
                "for the truth"
            )
    columns = [sensor.log_column for sensor in rig.sensors]
    _distinct([*columns, rig.log.time.column], "sensors: the log column")


def _check_maps(rig: Rig) -> None:
    """Refuse learned maps of other joints or sensors than the rig has."""
    learned = LearnedMaps() if rig.map is None else rig.map
    for name, each in learned.named().items():
        for channel in each.channels:
            _look_up(channel, rig.sensor_names, f"map.{name}.channels", "sensor")
    for kind in KINDS:
        of = [joint for each in getattr(learned, kind) for joint in each.joints]
        if kind == "efforts":
            for name in of:
                _look_up(name, rig.sensor_names, "map.efforts", "sensor")
        elif of and sorted(of) != sorted(rig.joint_names):
            raise ValueError(
                f"map.{kind}: each joint is needed once ({', '.join(rig.joint_names)})"
            )


def _distinct(names: Sequence[str], what: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{what} '{name}' stands more than once; names must differ")


def _share_alike(rig: Rig) -> None:
    """Refuse parameters that name the same shared error with different stds."""
    for name, sharing in rig.sharing().items():
        before, std = next(iter(sharing.items()))
        for path, other_std in sharing.items():
            if abs(other_std - std) > 1e-9 * std:
                raise ValueError(
                    f"{named(rig, path)}.shared: the error '{name}' is the same share of each "
                    "value; "
                    f"std {other_std:g} came here and {std:g} at {named(rig, before)}; make them "
                    "equal, or use two names"
                )


def _plays_apart(rig: Rig) -> None:
    """Refuse plays that cannot be put one behind the other."""
    several = {name for tendon in rig.tendons if len(tendon.joints) > 1 for name in tendon.joints}
    for joint in rig.joints:
        if joint.backlash is not None and (rig.is_chain or joint.name in several):
            raise ValueError(
                f"joints.{joint.name}.backlash: is not supported on a chain, nor where a tendon "
                "crosses several joints; "
                "describe it at the drive"
            )


def parameters_below(part: object, path: str = "") -> Iterator[tuple[str, Parameter]]:
    """Yield the parameters below a part, with their paths; the `path` of a whole rig is empty."""
    if isinstance(part, Parameter):
        yield path, part
    elif isinstance(part, (Description, tuple)):
        for key, member in enumerate(part) if isinstance(part, tuple) else part:
            yield from parameters_below(member, f"{path}.{key}" if path else str(key))


ALONE = 0.1
"""Std of a torque that acts on one joint alone, as a share of the largest torque that forces on
links make [1]: such a force acts near an axis, or along the chain. Source: benchmark
(docs/results/touch.md).
"""


def contact_shape(rig: Rig) -> Floats:
    """Return the covariance of the external torques on all joints that contacts make, (n_joints,
    n_joints), over a common scale [1].

    With as many drives as joints the measured forces tell the torques apart, so that each torque is
    taken as independent and equally likely: the unit matrix. With fewer drives a contact is a force
    at the end of a link, each direction and link being equally likely, on the chain at θ = 0: Σ Jᵀ
    J of the links' ends over its largest variance, with `ALONE`² added to each variance, or 1 for a
    joint that no such force turns.
    """
    n = len(rig.joints)
    if len(rig.drives) >= n:
        return np.eye(n)
    before = [rig.parent_of(j) for j in range(n)]
    axes = [joint.axis for joint in rig.joints]
    at = np.array([joint.offset for joint in rig.joints])
    moved_by = np.eye(n)
    for j, parent in enumerate(before):
        if parent is not None:
            at[j] += at[parent]
            moved_by[j] += moved_by[parent]
    shape = np.zeros((n, n))
    for j, joint in enumerate(rig.joints):
        ends = [at[k] for k in range(n) if before[k] == j]
        if not ends and joint.link is not None:
            ends = [at[j] + 2 * np.array(joint.link.centre)]
        for end in ends:
            moves = moved_by[j, :, None] * np.cross(axes, end - at)
            shape += moves @ moves.T
    largest = float(np.max(np.diag(shape)))
    if largest <= 0.0:
        return np.eye(n)
    alone = np.where(np.diag(shape) > 0.0, ALONE**2, 1.0)
    covariance: Floats = shape / largest + np.diag(alone)
    return covariance


@dataclass(frozen=True)
class Subsystem:
    """Joints that move one another, with all that pulls and measures them, as a rig of their own.

    Args:
        indices: kind → index in the whole rig of each of its joints, drives, tendons and sensors.
    """

    rig: Rig
    indices: dict[str, tuple[int, ...]]

    def whole_path(self, path: str) -> str:
        """Return the path in the whole rig of a number of the subsystem; both paths name parts by
        index.
        """
        kind, index, keys = _split(path)
        return f"{kind}.{self.indices[kind][int(index)]}.{keys}" if kind in self.indices else path

    def own_paths(self, paths: Sequence[str]) -> tuple[str, ...]:
        """Return the paths in the subsystem of those `paths` of the whole rig whose part it has; a
        path that names no part stays.
        """
        paths_in_part = []
        for path in paths:
            kind, index, keys = _split(path)
            if kind not in self.indices:
                paths_in_part.append(path)
            elif int(index) in self.indices[kind]:
                paths_in_part.append(f"{kind}.{self.indices[kind].index(int(index))}.{keys}")
        return tuple(paths_in_part)


def _split(path: str) -> tuple[str, str, str]:
    """Return the kind of part in a path, its index, and the keys below it."""
    kind, _, below = path.partition(".")
    index, _, keys = below.partition(".")
    return kind, index, keys


def independent_parts(rig: Rig) -> tuple[Subsystem, ...]:
    """Return the subsystems of a rig that share no link, tendon, drive, coupling or common error.

    A rig that cannot be split is returned whole; its parts have no learned maps.
    """
    together = [_joints_of(rig, f"drives.{d}") for d in range(len(rig.drives))]
    for i, joint in enumerate(rig.joints):
        parent = rig.parent_of(i)
        if parent is not None:
            together.append([i, parent])
        if joint.coupled is not None:
            together.append([i, rig.joint_names.index(joint.coupled.joint)])
    for sharing in rig.sharing().values():
        together.append([j for path in sharing for j in _joints_of(rig, path)])
    linked = np.zeros((len(rig.joints), len(rig.joints)))
    for joints in together:
        linked[np.ix_(joints, joints)] = 1.0
    count, groups = connected_components(linked, directed=False)
    if count == 1:
        indices = {kind: tuple(range(len(every))) for kind, every in rig.components.items()}
        return (Subsystem(rig, indices),)
    return tuple(
        _part(rig, np.flatnonzero(groups == group).tolist()) for group in dict.fromkeys(groups)
    )


def _joints_of(rig: Rig, path: str) -> list[int]:
    """Return the joints that the number at a path belongs to, or that its tendon or drive moves."""
    kind, index, _ = _split(path)
    at = int(index)
    if kind == "joints":
        return [at]
    pulled = [rig.tendons[at]] if kind == "tendons" else rig.tendons_of(rig.drive_names[at])
    return [rig.joint_names.index(name) for tendon in pulled for name in tendon.joints]


def _part(rig: Rig, joints: Sequence[int]) -> Subsystem:
    names = [rig.joint_names[j] for j in joints]
    tendons = [i for i, tendon in enumerate(rig.tendons) if tendon.joints[0] in names]
    pulled = {rig.tendons[i].drive for i in tendons}
    drives = [i for i, name in enumerate(rig.drive_names) if name in pulled]
    chosen = {"joints": tuple(joints), "drives": tuple(drives), "tendons": tuple(tendons)}
    chosen["sensors"] = tuple(
        i
        for i, sensor in enumerate(rig.sensors)
        if part_of(sensor, rig) in chosen[measurand_of(sensor).of]
    )
    parts: dict[str, object] = {
        kind: tuple(rig.components[kind][i] for i in indices) for kind, indices in chosen.items()
    }
    parents = {j: rig.parent_of(j) for j in joints}
    parts["joints"] = tuple(
        rig.joints[j].model_copy(update={"parent": BASE if on is None else rig.joint_names[on]})
        for j, on in parents.items()
    )
    return Subsystem(rig.model_copy(update={**parts, "map": None}), chosen)

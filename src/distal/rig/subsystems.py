"""Independent subsystems of a rig, which move without one another, such as the fingers of
a hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from distal.rig.joints import BASE
from distal.rig.rig import Rig
from distal.rig.sensors.registry import measurand_of


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
    joints = rig.joint_names
    together = [_joints_of(rig, f"drives.{d}") for d in range(len(rig.drives))]
    for i, joint in enumerate(rig.joints):
        parent = rig.parent_of(i)
        if parent is not None:
            together.append([joint.name, joints[parent]])
        if joint.coupled is not None:
            together.append([joint.name, joint.coupled.joint])
    for sharing in rig.sharing().values():
        together.append([name for path in sharing for name in _joints_of(rig, path)])
    linked = np.zeros((len(joints), len(joints)))
    for names in together:
        at = [joints.index(name) for name in names]
        linked[np.ix_(at, at)] = 1.0
    count, groups = connected_components(linked, directed=False)
    if count == 1:
        indices = {kind: tuple(range(len(every))) for kind, every in rig.components.items()}
        return (Subsystem(rig, indices),)
    return tuple(
        _part(rig, [name for name, alone in zip(joints, groups) if alone == group])
        for group in dict.fromkeys(groups)
    )


def _joints_of(rig: Rig, path: str) -> list[str]:
    """Return the joints that the number at a path belongs to, or that its tendon or drive moves."""
    kind, index = path.split(".")[:2]
    part = rig.components[kind][int(index)]
    if kind == "joints":
        return [part.name]
    pulled = [
        tendon
        for tendon in rig.tendons
        if part.name == (tendon.name if kind == "tendons" else tendon.drive)
    ]
    return [name for tendon in pulled for name in tendon.joints]


def _part(rig: Rig, names: list[str]) -> Subsystem:
    alone = {"joints": set(names)}
    pulling = [tendon for tendon in rig.tendons if tendon.joints[0] in names]
    alone["tendons"] = {tendon.name for tendon in pulling}
    alone["drives"] = {tendon.drive for tendon in pulling}
    chosen = {
        kind: tuple(i for i, part in enumerate(rig.components[kind]) if part.name in alone[kind])
        for kind in ("joints", "drives", "tendons")
    }
    chosen["sensors"] = tuple(
        i for i, sensor in enumerate(rig.sensors) if sensor.of in alone[measurand_of(sensor).of]
    )
    joints = chosen["joints"]
    parents = (rig.parent_of(j) for j in joints)
    names_of_parents = (BASE if parent is None else rig.joints[parent].name for parent in parents)
    parts = {
        kind: tuple(rig.components[kind][i] for i in indices) for kind, indices in chosen.items()
    }
    parts["joints"] = tuple(
        rig.joints[j].model_copy(update={"parent": p}) for j, p in zip(joints, names_of_parents)
    )
    return Subsystem(rig.model_copy(update={**parts, "map": None}), chosen)

"""Two joints side by side: the filter and its twin give the numbers of two rigs with one joint
each.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.estimators.adaptive import rigs
from tests.estimators.adaptive.agreement import TOLERANCE, course_of, difference, filtered
from tests.estimators.adaptive.rigs import side_by_side, sliders
from tests.estimators.adaptive.test_twin import DEFAULT, spoiled_log
from tests.estimators.adaptive.twin import Twin


def test_two_joints_side_by_side_are_two_rigs() -> None:
    """What has nothing in common has no covariance, and each part has the numbers that it has
    alone.
    """
    first = sliders(rigs.TORQUE, rigs.LINEARITY, rigs.DECLARED, without=("t1",))
    other = {
        "joints.0.spring": {"stiffness": {"value": 0.1, "std": 0.02}},
        "joints.0.inertia": 3e-4,
    }
    second = sliders(rigs.PATH, other, rigs.STOPS, without=("t1",))
    both = side_by_side(first, second)
    logs = spoiled_log(first), spoiled_log(second)
    time = logs[0][0]
    # positions of both, forces of both, references of both
    columns = [logs[i][1][:, c] for role in ((0, 1), (2, 3), (4,)) for i in (0, 1) for c in role]
    guards = replace(DEFAULT, unmodelled=0.5)
    found, course = filtered(both, (time, np.column_stack(columns)), guards)
    assert found.state_names[:4] == (
        "theta_link",
        "theta_link_2",
        "theta_link_dot",
        "theta_link_2_dot",
    )
    positions = []
    for i, rig in enumerate((first, second)):
        alone, single = filtered(rig, (time, logs[i][1]), guards)
        of_both = [found.state_names.index(name) for name in _renamed(alone.state_names, i)]
        positions.append(of_both)
        rows = np.ix_(range(len(time)), of_both, of_both)
        scale = single.prior
        assert np.max(np.abs(course.means[:, of_both] - single.means) / scale) < TOLERANCE
        assert (
            np.max(np.abs(course.covariances[rows] - single.covariances) / np.outer(scale, scale))
            < TOLERANCE
        )
    assert sorted(positions[0] + positions[1]) == list(range(len(found.state_names)))
    assert np.all(course.covariances[np.ix_(range(len(time)), *positions)] == 0.0)
    twin = Twin(both, guards, both.sensors_of("angle"))
    assert difference(course_of(twin, (time, np.column_stack(columns))), course) < TOLERANCE


def _renamed(names: tuple[str, ...], which: int) -> list[str]:
    """Return the names that the states of one rig have beside another one."""
    suffix = ("", "_2")[which]
    found = []
    for name in names:
        kind, *rest = name.split(".")
        if name in ("theta", "theta_dot"):
            found.append(name.replace("theta", f"theta_link{suffix}"))
        elif name == "external_torque":
            found.append(f"external_torque_link{suffix}")
        elif rest:
            shift = which * (1 if kind == "joints" else 2)
            found.append(".".join([kind, str(int(rest[0]) + shift), *rest[1:]]))
        elif name.startswith("linearity_"):
            stem, order = name.rsplit("_", 1)
            found.append(f"{stem}{suffix}_{order}")
        else:
            found.append(f"{name}{suffix}")
    return found

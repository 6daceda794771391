"""A rig from ROS bags and MCAP files: columns are topics, fields and names of joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from distal import read_log
from distal.cli.app import app
from distal.from_logs import rig_from_logs
from distal.logs.tables import recorded_columns
from tests.from_logs.logs import Floats, finger
from tests.logs.recordings import Recorder, write_bag

MOTORS, JOINTS = ("a", "b", "c"), ("mcp", "pip")


def bag(columns: Mapping[str, Floats], folder: Path) -> Path:
    """Write a bag of ROS 2 with a topic of motors [m, N] and one of references [rad]."""
    positions = np.column_stack([1e-3 * columns[f"x_{name}_mm"] for name in MOTORS])
    forces = np.column_stack([columns[f"F_{name}"] for name in MOTORS])
    angles = np.deg2rad(np.column_stack([columns[f"{name}_deg"] for name in JOINTS]))
    stamps = [round(1.7e18 + ms * 1e6) for ms in columns["t_ms"]]
    rows = list(zip(stamps, positions, forces, angles))[::2]
    motors = [("/motors", at, at, MOTORS, position, force) for at, position, force, _ in rows]
    references = [("/reference", at, at, JOINTS, angle, []) for at, _, _, angle in rows]
    return write_bag(folder, [*motors, *references])


def test_a_rig_from_bags_reads_these_bags(tmp_path: Path) -> None:
    paths = [bag(finger(k), tmp_path / f"run_{k}") for k in range(3)]
    drives = {f"/motors[{name}].position": "m" for name in MOTORS}
    truth = [f"/reference[{name}].position" for name in JOINTS]
    efforts = [f"/motors[{name}].effort" for name in MOTORS]
    assert sorted(recorded_columns(paths[0])) == sorted([*drives, *efforts, *truth])
    found = rig_from_logs(paths, truth=truth, drives=drives)
    assert len(found.rig.drives) == 3
    assert len(found.rig.joints) == 2
    log = read_log(paths[0], found.rig)
    assert len(log) == len(finger(0)["t_ms"]) / 2
    angles = np.column_stack([log.truth[f"theta_{name}"] for name in found.rig.joint_names])
    expected = np.deg2rad(np.column_stack([finger(0)[f"{name}_deg"] for name in JOINTS]))
    np.testing.assert_allclose(np.sort(angles[0]), np.sort(expected[0]), atol=1e-9)


def mcap(columns: Mapping[str, Floats], path: Path) -> Path:
    """Write an MCAP file of JSON messages with nested fields."""
    recorder = Recorder(path)
    for k, ms in list(enumerate(columns["t_ms"]))[::2]:
        content = {"timestamp": 1.7e9 + 1e-3 * ms, "is_on": True, "mode": "idle"}
        content |= {name: float(values[k]) for name, values in columns.items() if name != "t_ms"}
        recorder.add("/hand", 1e-3 * ms, {**content, "cells": [float(columns["F_a"][k])] * 100})
    recorder.close()
    return path


def test_the_command_takes_mcap(tmp_path: Path) -> None:
    paths = [mcap(finger(k), tmp_path / f"run_{k}.mcap") for k in range(3)]
    columns = recorded_columns(paths[0])
    assert columns == [f"/hand.{name}" for name in finger(0) if name != "t_ms"]
    out = tmp_path / "rig.toml"
    done = CliRunner().invoke(app, ["rig", "from-logs", *map(str, paths), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert 'column = "/hand.x_a_mm"' in out.read_text(encoding="utf-8")


def test_a_bag_without_numbers_says_so(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    Recorder(path).close()
    with pytest.raises(Exception, match="no message has numbers"):
        rig_from_logs([path])

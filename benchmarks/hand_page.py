"""The commands of docs/how-to/my-hand.md one after the other, timed: `python -m
benchmarks.hand_page`.

The hand is one of `tests.support.servo_hands`, behind the three methods that `distal.hands` asks of
any hand; its routine runs on a clock of its own, as fast as the plant does.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tests.support.hands import Driven
from tests.support.servo_hands import PERIOD, orca_like

import distal.hands
from benchmarks.report import table

TABLE = """joint,motor,spool_radius [mm],joint_radius [mm],direction,low [deg],high [deg]
index_mcp,m1,7.272727,8,1,-25,100
ring_abd,m2,7.608696,7,1,-27,27
"""


class Motors:
    """A simulated hand with the methods of `distal.hands.Motors`, in radians and milliamperes."""

    def __init__(self) -> None:
        _, self.hands = orca_like([3], ("index_mcp", "ring_abd"))
        self.driven, self.positions = (
            Driven(self.hands),
            self.hands.positions + self.hands.d.zeros * self.hands.d.signs,
        )
        self.torques = np.zeros_like(self.positions)

    def read(self) -> dict[str, float]:
        """Return what the motors read."""
        return {
            f"m{k + 1}_{name}": float(factor * values[0, k])
            for name, factor, values in (
                ("position", 1.0, self.positions),
                ("current", 2000.0, self.torques),
            )
            for k in range(2)
        }

    def temperatures(self) -> dict[str, float]:
        """Return none."""
        return {}

    def write(self, goals: Mapping[str, float]) -> None:
        """Let one period pass on the way to some goals [rad]."""
        desired = np.array([[goals.get(f"m{k + 1}", self.positions[0, k]) for k in range(2)]])
        self.positions, self.torques = self.driven.read(desired)


def main() -> None:
    """Print what each command takes, and how far live angles are off."""
    rows, now, record = list[list[str]](), [0.0], list[list[float]]()

    def timed(name: str, do: Any) -> Any:
        begin = time.perf_counter()
        done = do()
        rows.append([name, f"{time.perf_counter() - begin:.1f}"])
        return done

    def tick(seconds: float = PERIOD) -> None:
        now[0] += PERIOD
        record.append([now[0], *motors.read().values()])

    with tempfile.TemporaryDirectory() as folder:
        root, motors = Path(folder), Motors()
        (root / "hand.csv").write_text(TABLE)

        def run(*arguments: str) -> None:
            subprocess.run(
                [sys.executable, "-m", "distal", *arguments],
                check=True,
                capture_output=True,
                cwd=root,
            )

        timed(
            "distal rig from-table",
            lambda: run("rig", "from-table", "hand.csv", "--out", "hand.toml"),
        )
        hand = distal.hands.Hand(motors, root / "hand.toml")
        timed(
            "power_on, its clock as fast as the plant",
            lambda: hand.power_on(sleep=tick, now=lambda: now[0]),
        )
        header = ",".join(["time", *motors.read()])
        np.savetxt(root / "routine.csv", record, delimiter=",", header=header, comments="")
        options = "--rig", "hand.toml", "--out", "calibrated.toml"
        timed("distal calibrate", lambda: run("calibrate", "routine.csv", *options))
        live = timed(
            "Hand, first kernel", lambda: distal.hands.Hand(motors, root / "calibrated.toml")
        )
        off = list[list[float]]()

        def move() -> None:
            live.update(now[0])
            for k in range(1000):
                live.set_joint_positions(
                    {
                        "index_mcp": 40.0 + 30.0 * np.sin(0.02 * k),
                        "ring_abd": 10.0 * np.sin(0.03 * k),
                    }
                )
                tick()
                live.update(now[0])
                truth = np.rad2deg(motors.hands.angles[0])
                off.append(
                    [
                        live.get_joint_positions()[name] - truth[j]
                        for j, name in enumerate(("index_mcp", "ring_abd"))
                    ]
                )

        timed("1,000 updates with goals", move)
    table(
        "hand-page",
        f"live angles are {np.sqrt(np.mean(np.square(off))):.1f}° off",
        ["what", "seconds"],
        rows,
    )


if __name__ == "__main__":
    main()

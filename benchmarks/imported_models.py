"""Rigs from MuJoCo models as they come, without a fit: `python -m benchmarks.imported_models
[FOLDER …]`.

Plants, drawn by seed, are MuJoCo's own; they share no code with `distal.model`. Those of the hands
in `benchmarks.models` need the folders of the unpacked wheels `playground` and `myo_sim`. Fingers
of one's own are drawn with their models: arms, springs, `frictionloss`, damping, with motors that
pull the tendons as the model has them (nothing stretches, the recorder's log), or behind drives
with a stretch that the model does not say, without a third joint or with one that is softly
coupled.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from tests.support.mujoco_fingers import PULL, own_finger, unstretched

from benchmarks.models import HANDS, found, plant, recorded, specification
from benchmarks.report import table
from benchmarks.shell import estimate
from distal import Log, Rig
from distal.rig import from_mujoco

Made = Callable[[int], tuple[Rig, Log]]


def stretched(seed: int, coupled: bool) -> tuple[Rig, Log]:
    """Return the rig of an own finger, and a log of it behind drives, with a stretch, friction,
    noise: `models.plant`.
    """
    text = own_finger(seed, coupled)
    rig = from_mujoco(mujoco.MjModel.from_xml_string(text)).rig
    return rig, recorded(plant(mujoco.MjSpec.from_string(text), rig, seed), rig, 10 * seed, *PULL)


def of_hand(folders: list[Path], name: str) -> Made:
    """Return what makes the rig and a log of one of `HANDS`."""
    rig = found(folders, name)[0].rig
    return lambda seed: (
        rig,
        recorded(plant(specification(folders, name), rig, seed), rig, 10 * seed),
    )


def kinds(folders: list[Path]) -> dict[str, Made]:
    """Return what is tried, by name."""
    hands = {name: of_hand(folders, name) for name in HANDS} if folders else {}
    return hands | {
        "own finger": lambda seed: unstretched(seed, False),
        "own finger, stretch": lambda seed: stretched(seed, False),
        "own finger, soft coupling": lambda seed: unstretched(seed, True),
        "own finger, soft coupling, stretch": lambda seed: stretched(seed, True),
    }


def figures(rig: Rig, log: Log) -> tuple[float, float, float]:
    """Return RMS error, mean over the joints, and median half-width of the band [deg], and the
    share inside it [%].
    """
    got = estimate(log, rig, "adaptive")
    off = got.angles - np.column_stack([log.truth[f"theta_{joint.name}"] for joint in rig.joints])
    wide = 1.96 * got.angle_stds
    rms = np.sqrt(np.mean(off**2, axis=0)).mean()
    return (
        float(np.rad2deg(rms)),
        float(np.rad2deg(np.median(wide))),
        100 * float(np.mean(np.abs(off) <= wide)),
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.imported_models", description=__doc__
    )
    parser.add_argument("folders", nargs="*", type=Path, help="with models")
    parser.add_argument("--seeds", type=int, default=10, help="plants of each kind")
    parser.add_argument("--first-seed", type=int, default=11)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for name, made in kinds(given.folders).items():
        values = np.array(
            [
                figures(*made(seed))
                for seed in range(given.first_seed, given.first_seed + given.seeds)
            ]
        )
        rms, wide, inside = values.T
        rows.append(
            [
                name,
                f"{np.median(rms):.2f}",
                f"{rms.max():.2f}",
                f"{np.median(wide):.2f}",
                f"{inside.mean():.0f}",
                ", ".join(f"{share:.0f}" for share in sorted(inside)),
            ]
        )
        print(*rows[-1], flush=True)
    columns = [
        "model",
        "RMS, median [°]",
        "largest",
        "half-width, median [°]",
        "inside [%]",
        "each plant",
    ]
    table(
        "imported-models",
        f"Imported models without a fit, {given.seeds} plants each",
        columns,
        rows,
    )


if __name__ == "__main__":
    main()

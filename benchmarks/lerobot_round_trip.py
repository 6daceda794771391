"""What LeRobot's own reader says of `distal estimate DATASET --into NEW`: `python -m
benchmarks.lerobot_round_trip` for datasets that LeRobot's own writer made of drawn readings, or
with `--dataset FOLDER ANGLE TORQUE UNIT` for one that somebody else published, where two names of
numbers of its state stand for the sensors of `capstan-joint` (its torque then says nothing, and its
angles are no robot's). On GitHub are YifanTian07/G1-policy-train (2.1; kLeftHandIndex,
kRightHandIndex, rad), and of version 3.0 chenfei-source/ACT-robot-manipulation (gripper.pos,
joint_6.pos, deg) and SamueleSandrini/record-test (gripper.pos, wrist_roll.pos, deg).

lerobot is heavy: it is for environments of its own (`make lerobot`). Release 0.4.4 writes and reads
datasets of version 3.0, release 0.3.3 those of 2.1, and reads 2.0, into which some are turned here.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from distal import Rig, estimate, load_rig, read_log
from distal.bridges.lerobot import ANGLE, STATE, STD, WORD
from distal.rig import edited_text
from distal.run import HEALTH, log_health

PICTURES = ("none", "image", "video")
TYPES = {ANGLE: "float32", STD: "float32", WORD: "int64"}
SEEN = 200
"""About so many frames of a dataset are read with their pictures; of all, the numbers."""

Case: TypeAlias = tuple[str, list[str], str]
"""Name of a rig, its changes for a dataset, and what is special about the dataset."""


def described(info: Any) -> dict[str, Any]:
    """Return a dataset's description, which is an object since release 0.6."""
    return dict(info) if isinstance(info, dict) else vars(info)


def feature(kind: str, *shape: int, names: object = None) -> dict[str, Any]:
    """Return a feature as LeRobot describes it."""
    return {"dtype": kind, "shape": shape, "names": names}


OTHERS = {
    "action": feature("float32", 2),
    "next.done": feature("bool", 1),
    "observation.effort": feature("float64", 3),
    "observation.matrix": feature("float32", 2, 3),
    "note": feature("string", 1),
}
"""Features that a drawn dataset may have."""


def column(sensor: str, motor: str) -> str:
    """Return the change of a rig by which a sensor is a number of the state."""
    return f'sensors.{sensor}.column="{STATE}.{motor}"'


def drawn(folder: Path, seed: int) -> Case:
    """Write a dataset by LeRobot's own writer."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    rng = np.random.default_rng(seed)
    name = str(rng.choice(["capstan-joint", "finger-2n", "wrist-instrument"]))
    sensors = [sensor.name for sensor in load_rig(name).sensors if sensor.measures != "angle"]
    motors = [f"{sensor}.pos" for sensor in sensors] + ["left", "right"][: rng.integers(3)]
    rng.shuffle(motors)
    forms = {
        "list": motors,
        "group": {"motors": motors},
        "nested": [motors],
        "positions": {motor: k for k, motor in enumerate(motors)},
    }
    form, pictures = str(rng.choice(list(forms))), str(rng.choice(PICTURES))
    features = {STATE: feature("float32", len(motors), names=forms[form])}
    others = rng.choice(list(OTHERS), rng.integers(len(OTHERS)), replace=False)
    features |= {other: OTHERS[other] for other in others.tolist()}
    if pictures != "none":
        size = ["height", "width", "channels"]
        features["observation.images.top"] = feature(pictures, 64, 96, 3, names=size)
    fps = int(rng.choice([15, 30, 50, 200]))
    dataset = LeRobotDataset.create("a/set", fps, features, root=folder)
    is_new = hasattr(dataset, "finalize")
    if isinstance(dataset.meta.info, dict):
        dataset.meta.info["chunks_size"] = 2
    if is_new:
        dataset.meta.update_chunk_settings(2, 0.02, 0.02)  # files of so many MB
    tasks = ["Grasp the cup.", "Öffne die Hand", "手を閉じる"][: rng.integers(1, 4)]
    for _ in range(rng.integers(2, 8)):
        is_single = rng.random() < 0.08 and "observation.matrix" not in features  # 0.4.4 fails
        rows = 1 if is_single else rng.integers(2, 150)
        for state in 1e-3 * np.cumsum(rng.normal(size=(rows, len(motors))), axis=0):
            frame = {key: value_of(of["dtype"], of["shape"], rng) for key, of in features.items()}
            frame[STATE] = state.astype(np.float32)
            task = {"task": str(rng.choice(tasks))}
            dataset.add_frame(frame | task) if is_new else dataset.add_frame(frame, **task)
        dataset.save_episode()
    if is_new:
        dataset.finalize()
    elif seed % 3 == 0:
        as_version_2_0(dataset.meta)
    changes = [column(sensor, f"{sensor}.pos") for sensor in sensors]
    return name, changes, f"{name}, {form}, {pictures}"


def value_of(kind: str, shape: tuple[int, ...], rng: np.random.Generator) -> Any:
    """Draw what a frame has of a feature."""
    if kind == "string":
        return f"note {rng.integers(9)}"
    if kind in PICTURES:
        return np.full(shape, rng.integers(256, size=3), dtype=np.uint8)
    return (rng.normal(size=shape) > 0.0 if kind == "bool" else rng.normal(size=shape)).astype(kind)


def as_version_2_0(meta: Any) -> None:
    """Turn a dataset of version 2.1 into one of 2.0, which has statistics of all its rows alone."""
    folder = meta.root / "meta"
    kinds = ("min", "max", "mean", "std")
    stats = {key: {what: of[what].tolist() for what in kinds} for key, of in meta.stats.items()}
    (folder / "stats.json").write_text(json.dumps(stats))
    (folder / "episodes_stats.jsonl").unlink()
    (folder / "info.json").write_text(
        json.dumps(described(meta.info) | {"codebase_version": "v2.0"})
    )


def published(folder: Path, source: str, angle: str, torque: str, unit: str) -> Case:
    """Copy a dataset; empty files stand for the videos that it lacks, and are not looked at."""
    from lerobot.datasets.lerobot_dataset import LeRobotDatasetMetadata

    shutil.copytree(source, folder)
    meta = LeRobotDatasetMetadata("a/set", folder)
    lacking = 0
    for episode in range(meta.total_episodes):
        for key in meta.video_keys:
            video = folder / meta.get_video_file_path(episode, key)
            video.parent.mkdir(parents=True, exist_ok=True)
            lacking += not video.exists()
            video.touch()
    changes = [column("motor_angle", angle), f'sensors.motor_angle.unit="{unit}"']
    changes += [column("motor_torque", torque), 'sensors.motor_torque.noise="1e6 N m"']
    return "capstan-joint", changes, f"{source}, {lacking} videos lacking"


def hashes(folder: Path) -> dict[str, str]:
    """Return path → hash of all files of a folder."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


def is_same(one: Any, other: Any) -> bool:
    """Return whether two values that LeRobot read are equal, and of the same types."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(is_same(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(is_same, one, other))
    if not hasattr(one, "dtype"):
        return bool(one == other)
    is_real = np.asarray(one).dtype.kind == "f"
    return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=is_real)


def are_near(known: dict[str, Any], values: np.ndarray, kinds: Iterable[str], at: Any) -> bool:
    """Return whether statistics are of these kinds, and those of the rows `at` some places that
    have an estimate; where none has one, those of all rows, with a count of 0.
    """
    finite = np.isfinite(values).all(axis=1)
    count = int(np.sum(finite & at))
    rows = values[finite & at if count else finite].astype(np.float64)
    sound = {
        what: np.quantile(rows, float(what[1:]) / 100.0, axis=0)
        if what.startswith("q")
        else np.array([count])
        if what == "count"
        else getattr(np, what)(rows, axis=0)
        for what in kinds
    }
    rounding = 1e-6 * np.abs(rows).max()  # the file has single precision
    return known.keys() == sound.keys() and all(
        np.allclose(known[what], of, rtol=1e-6, atol=rounding) for what, of in sound.items()
    )


def by_episode(meta: Any, feature: str) -> dict[int, dict[str, Any]]:
    """Return episode → statistics of a feature as the files have them; version 2.0 has none."""
    if described(meta.info)["codebase_version"] == "v2.0":
        return {}
    if hasattr(meta, "episodes_stats"):
        return {episode: stats[feature] for episode, stats in meta.episodes_stats.items()}
    start = f"stats/{feature}/"
    files = sorted((meta.root / "meta" / "episodes").rglob("*.parquet"))
    return {
        row["episode_index"]: {
            key.removeprefix(start): of for key, of in row.items() if key.startswith(start)
        }
        for file in files
        for row in pq.read_table(file).to_pylist()
    }


def tables(meta: Any) -> list[Any]:
    """Return the tables of tasks and of episodes, in either version."""
    if isinstance(meta.tasks, dict):
        return [meta.tasks, meta.episodes]
    return [meta.tasks.to_dict(), list(meta.episodes)]


def estimated(old: Any, rows: dict[str, Any], rig: Rig) -> dict[str, np.ndarray]:
    """Return the new features as `estimate` gives them for what LeRobot reads of the original."""
    names = old.meta.features[STATE]["names"]
    motors = np.ravel(names.get("motors", list(names)) if isinstance(names, dict) else names)
    frames = pd.DataFrame(np.stack(rows[STATE]), columns=[f"{STATE}.{motor}" for motor in motors])
    frames["timestamp"] = np.array(rows["timestamp"], dtype=np.float64)
    parts: dict[str, list[np.ndarray]] = {key: [] for key in TYPES}
    words = list(HEALTH)
    for _, frame in frames.groupby(np.array(rows["episode_index"])):
        angles = stds = np.full((len(frame), len(rig.joints)), np.nan)
        codes = [words.index("bad")] * len(frame)
        if len(frame) > 1:  # one row is no log
            log = read_log(frame, rig)
            found = estimate(log, rig)
            angles, stds = np.rad2deg(found.angles), np.rad2deg(found.angle_stds)
            codes = [words.index(word) for word in log_health(log, rig)]
        for key, of in ((ANGLE, angles), (STD, stds), (WORD, np.array(codes)[:, None])):
            parts[key].append(of)
    return {key: np.vstack(of).astype(TYPES[key]) for key, of in parts.items()}


def faults(original: Path, copy: Path, rig: Rig) -> list[str]:
    """Return what LeRobot reads of the copy that is not as it should be."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    def opened(root: Path, **more: Any) -> Any:
        return LeRobotDataset("a/set", root, video_backend="pyav", **more)

    old, new = opened(original), opened(copy)
    before, after = old.hf_dataset[:], new.hf_dataset[:]
    names = {ANGLE: list(rig.joint_names), STD: list(rig.joint_names), WORD: ["health"]}
    features = old.meta.features | {
        key: {"dtype": TYPES[key], "shape": (len(of),), "names": of} for key, of in names.items()
    }
    values = {key: np.stack(after[key]).reshape(len(new), -1) for key in TYPES}
    episodes = np.array(after["episode_index"])
    ends = np.flatnonzero(np.diff(episodes, append=-1)).tolist()
    seen = {0, *ends, *np.linspace(0, ends[-1], SEEN).astype(int).tolist()}
    for key in old.meta.video_keys:
        videos = [original / old.meta.get_video_file_path(k, key) for k in episodes.tolist()]
        seen = {k for k in seen if videos[k].stat().st_size}
    last = opened(copy, episodes=[int(episodes[-1])]).hf_dataset[:][ANGLE]
    window = opened(copy, delta_timestamps={ANGLE: [-1.0 / new.fps, 0.0]})
    was, files = hashes(original), hashes(copy)
    rewritten = ("data/", "meta/info", "meta/stats", "meta/episodes_stats", "meta/episodes/")
    checks = {
        "size": (len(new), new.num_episodes) == (len(old), old.num_episodes),
        "values": is_same(before, {key: after[key] for key in before}),
        "frames": all(is_same(old[k], {key: new[k][key] for key in old[k]}) for k in seen),
        "description": is_same(
            described(new.meta.info), described(old.meta.info) | {"features": features}
        ),
        "tables": is_same(tables(new.meta), tables(old.meta)),
        "estimates": is_same(values, estimated(old, before, rig)),
        "window": all(is_same(window[k][ANGLE][1], new[k][ANGLE]) for k in sorted(seen)[:20]),
        "one episode": is_same(last, after[ANGLE][len(after[ANGLE]) - len(last) :]),
        "old statistics": all(
            is_same(of, new.meta.stats[key]) for key, of in old.meta.stats.items()
        ),
        "statistics": all(
            are_near(new.meta.stats[key], values[key], old.meta.stats[STATE], True) for key in TYPES
        ),
        "statistics of episodes": all(
            are_near(by_episode(new.meta, key)[k], values[key], kinds, episodes == k)
            for k, kinds in by_episode(old.meta, STATE).items()
            for key in TYPES
        ),
        "other files": all(
            files[path] == of for path, of in was.items() if not path.startswith(rewritten)
        ),
    }
    return [what for what, holds in checks.items() if not holds]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--dataset", nargs=4, metavar=("FOLDER", "ANGLE", "TORQUE", "UNIT"))
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + (1 if asked.dataset else asked.sets))
    sound = 0
    for seed in seeds:
        with tempfile.TemporaryDirectory() as home:
            original, copy, file = (Path(home) / name for name in ("set", "new", "rig.toml"))
            case = published(original, *asked.dataset) if asked.dataset else drawn(original, seed)
            name, changes, kind = case
            file.write_text(edited_text(name, ['log.time.column="timestamp"', *changes]), "utf-8")
            was = hashes(original)
            words = f"-m distal estimate {original} --rig {file} --into {copy} --unit deg".split()
            done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
            found = [done.stderr] if done.returncode else faults(original, copy, load_rig(file))
            found += ["original"] if hashes(original) != was else []
            sound += not found
            info = json.loads((original / "meta" / "info.json").read_text("utf-8"))
            files = sum(path.startswith("data/") for path in was)
            counts = f"{info['total_episodes']}|{files}|{info['total_frames']}"
            verdict = "; ".join(found) or "as it should be"
            print(f"|{seed}|{info['codebase_version']}|{kind}|{counts}|{verdict}|", flush=True)
    print(f"lerobot {version('lerobot')}: {sound} of {len(seeds)} as they should be")


if __name__ == "__main__":
    quiet = {"HF_DATASETS_DISABLE_PROGRESS_BARS": "1", "SVT_LOG": "1"}
    with tempfile.TemporaryDirectory() as cache:
        os.environ |= {"HF_HUB_OFFLINE": "1", "HF_HOME": cache, **quiet}
        main()

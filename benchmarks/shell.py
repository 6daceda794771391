"""What a user runs: `distal` in a folder or in this process, and the files that it writes."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal import Log, Rig, load_rig, read_log, write_log
from distal.cli.app import app
from distal.confidence import BAND
from distal.errors import DistalWarning
from distal.estimators import usual_estimator
from distal.fitting.fit import write_fitted
from distal.logs import name_and_unit, read_table, true_angles
from distal.rig import angle_names, torque_names
from distal.rig.validation import std_name

Floats = NDArray[np.float64]


def command(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `distal` in a folder, as a shell does."""
    return subprocess.run(
        [sys.executable, "-m", "distal", *words], cwd=folder, capture_output=True, text=True
    )


def write_rig(rig: Rig, path: Path) -> None:
    """Write a rig as its owner has it in a file."""
    write_fitted(path, rig, rig.bare(), {}, "", None)


def written(rig: Rig, logs: Sequence[Log], subcommand: str, *words: str) -> Rig:
    """Return the rig of the file that `distal fit` or `distal calibrate` writes from some logs.

    Raises:
        RuntimeError: the command did not end with its file.
    """
    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        write_rig(rig, folder / "mine.toml")
        names = [f"run_{i}.csv" for i in range(len(logs))]
        for name, log in zip(names, logs):
            write_log(log, rig, folder / name)
        done = command(
            folder, subcommand, *names, "--rig", "mine.toml", "--out", "written.toml", *words
        )
        if done.returncode:
            raise RuntimeError(done.stderr.strip().splitlines()[-1])
        return load_rig(folder / "written.toml")


@dataclass(frozen=True)
class Found:
    """What `distal estimate` wrote of a log, beside the log's true angles.

    Args:
        time: stamps [s], (k,).
        angles: of the joints [rad], (k, n_joints).
        angle_stds: their standard deviations [rad], (k, n_joints).
        truths: true angles [rad], (k, n_joints); None where the log has none.
        torques: external torque of each joint that has one [N m], (k,) each, by the joint.
        log: the log as it was read from its file.
    """

    time: Floats
    angles: Floats
    angle_stds: Floats
    truths: Floats | None
    torques: Mapping[str, Floats]
    log: Log

    @property
    def theta_std(self) -> Floats:
        """The standard deviations of a single joint's angle [rad], (k,)."""
        return self.angle_stds[:, 0] if self.angle_stds.shape[1] == 1 else self.angle_stds

    def errors(self) -> Floats:
        """Return angle minus truth [rad], (k,) of one joint, else (k, n_joints)."""
        assert self.truths is not None
        errors = self.angles - self.truths
        return errors[:, 0] if errors.shape[1] == 1 else errors

    def rms_error(self) -> float:
        """Return the RMS error over all joints [rad]."""
        return float(np.sqrt(np.nanmean(self.errors() ** 2)))

    def inside_band(self) -> float:
        """Return the share of samples inside the 95 % band [1]."""
        errors = self.errors()
        is_known = np.isfinite(errors)
        return float(np.mean(np.abs(errors)[is_known] <= BAND * self.theta_std[is_known]))


def estimate(
    log: Log,
    rig: Rig,
    estimator: str | None = None,
    *,
    homing: float | None = None,
    compiled: bool = True,
    covariances: bool = False,
) -> Found:
    """Return what a user finds: the log and the rig as files, `distal estimate`, and its file.

    The command runs in this process, so that it costs little. Arguments that no user gives are
    taken and change nothing.

    Raises:
        DistalError: the command ends with one.
    """
    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        write_rig(rig, folder / "mine.toml")
        write_log(log, rig, folder / "log.csv")
        words = ["estimate", str(folder / "log.csv"), "--rig", str(folder / "mine.toml")]
        words += ["--out", str(folder / "out.csv"), "--unit", "rad"]
        words += ["-e", usual_estimator(rig) if estimator is None else estimator]
        words += ["--no-what-if"]
        words += [] if homing is None else ["--homing", f"{homing:g} s"]
        with redirect_stdout(StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore", DistalWarning)
            code = app(words, standalone_mode=False)
            log_read = read_log(folder / "log.csv", rig)
        if code:
            raise RuntimeError(f"distal estimate ended with {code}")
        table = read_table(folder / "out.csv")
    columns = {name_and_unit(name)[0]: table.values(name) for name in table.names}
    names = angle_names(rig.joint_names)
    torques = torque_names(rig.joint_names)
    return Found(
        time=columns["t"],
        angles=np.column_stack([columns[name] for name in names]),
        angle_stds=np.column_stack([columns[std_name(name)] for name in names]),
        truths=true_angles(log, rig.joint_names),
        torques={j: columns[t] for j, t in zip(rig.joint_names, torques) if t in columns},
        log=log_read,
    )

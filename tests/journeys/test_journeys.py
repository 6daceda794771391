"""Whole ways of the docs as commands in a shell, in an empty folder, with the installed wheel.

The plants lack nothing that a user's rig has: sheaths, creep, other arms. `make journeys` takes
more seeds (DISTAL_JOURNEYS).
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from distal import load_rig, read_log, write_log
from distal.fitting.fit import plain_value
from tests.journeys.matrix import REPLAY
from tests.journeys.shell import Shell, installed
from tests.support.foreign_plants import finger_log, finger_rig

pytestmark = pytest.mark.slow

SEEDS = range(int(os.environ.get("DISTAL_JOURNEYS", "1")))
COMPILES = shutil.which("cc") is not None


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return installed(tmp_path_factory.mktemp("wheel"))


@pytest.fixture
def shell(tmp_path: Path, site: Path) -> Shell:
    return Shell(tmp_path, site)


def rms_of(identified: str, estimator: str = "adaptive") -> float:
    """Return the error against the truth that `distal estimate` printed [°]."""
    row = next(line for line in identified.splitlines() if line.split()[:1] == [estimator])
    return float(row.split()[1])


def column(path: Path, name: str) -> np.ndarray:
    """Return a column of a file, by the beginning of its header."""
    header = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    at = next(i for i, head in enumerate(header) if head.strip('"').startswith(name))
    return np.genfromtxt(path, delimiter=",", skip_header=1, usecols=at)


def desired(folder: Path, name: str, low: float, high: float) -> None:
    """Write a desired trajectory that goes up and down between two angles [°]."""
    time = np.arange(0.0, 4.0, 0.01)
    angles = low + (high - low) * 0.5 * (1.0 - np.cos(np.pi * time / 2.0))
    lines = [f"{t:.2f},{a:.6f}" for t, a in zip(time, angles)]
    (folder / "wanted.csv").write_text("\n".join([f"t [s],{name} [deg]", *lines]) + "\n")


def goes_on(shell: Shell, rig: str, log: str, name: str) -> None:
    """Command, stream, export and run the C, with a rig file and a log."""
    shell.run(
        f"""
        distal command wanted.csv --rig {rig} --out commands.csv
        distal estimate {log} --rig {rig} -e adaptive --no-what-if --out estimate.csv --unit rad
        distal stream --rig {rig} --unit rad < {log} > stream.csv
        distal export-c {rig} --out firmware --name joint
        """
    )
    offline = column(shell.folder / "estimate.csv", name)
    np.testing.assert_allclose(column(shell.folder / "stream.csv", name), offline, atol=1e-9)
    assert np.isfinite(column(shell.folder / "commands.csv", name)).all()
    if COMPILES:
        shell.run(
            f"""
            {sys.executable} {REPLAY} {rig} joint > firmware/replay.c
            cd firmware
            cc -std=c99 -O2 -fno-math-errno replay.c joint.c -lm -o replay
            ./replay ../{log} > ../replayed.csv
            """
        )
        replayed = column(shell.folder / "replayed.csv", name)
        np.testing.assert_allclose(replayed, offline, atol=1e-7)


@pytest.mark.more  # fits of the command line: tests/test_tutorial.py, tests/cli/test_fit.py
@pytest.mark.parametrize("seed", SEEDS)
def test_a_researcher_with_logs_of_a_rig(seed: int, shell: Shell) -> None:
    """A finger with a Bowden cable, whose friction along the cable its file is silent about."""
    rig = finger_rig()
    text = tomlkit.dumps(plain_value(rig.model_dump(exclude_defaults=True)))
    (shell.folder / "mine.toml").write_text("# my finger\n" + text, encoding="utf-8")
    for i in range(4):
        write_log(finger_log(10 * seed + i, 8.0), rig, shell.folder / f"run_{i}.csv")
    identified = shell.run(
        """
        distal rig check mine.toml
        distal estimate run_3.csv --rig mine.toml -e adaptive --no-what-if
        """
    )
    before = rms_of(identified)
    identified = shell.run(
        "distal fit run_0.csv run_1.csv run_2.csv --rig mine.toml --out fitted.toml"
    )
    assert "wrote fitted.toml" in identified
    assert "# my finger" in (shell.folder / "fitted.toml").read_text(encoding="utf-8")
    identified = shell.run(
        "distal rig check fitted.toml\n"
        "distal estimate run_3.csv --rig fitted.toml -e adaptive --no-what-if"
    )
    assert rms_of(identified) < 0.5 * before
    desired(shell.folder, "theta", 20.0, 60.0)
    goes_on(shell, "fitted.toml", "run_3.csv", "theta")


@pytest.mark.more
@pytest.mark.parametrize("seed", SEEDS)
def test_a_builder_with_a_table(seed: int, shell: Shell) -> None:
    """A hand of two motors from a table with counts; its plant is looser and rubs more."""
    table = (
        "joint,motor,spool_radius [mm],joint_radius [mm],direction,low [deg],high [deg],counts,"
        "zero [count],position_column,current_column\n"
        "mcp,1,7,8,1,-20,95,4096,100,pos1,cur1\n"
        "pip,2,7,7.5,-1,0,105,4096,-40,pos2,cur2\n"
    )
    (shell.folder / "hand.csv").write_text(table, encoding="utf-8")
    shell.run(
        """
        distal rig from-table hand.csv --out hand.toml
        distal rig check hand.toml
        distal rig draw hand.toml --out hand.svg
        """
    )
    scenario = (
        'rig = "hand.toml"\nduration = "4 s"\n'
        '[plant]\n"tendons.*.path.friction" = 0.2\n'
        '[drives.motor_1.servo]\nangle = [["0 s","0 deg"],["2 s","60 deg"],["4 s","10 deg"]]\n'
        'stiffness = "20 N m/rad"\ndamping = "0.1 N m s/rad"\n'
        '[drives.motor_2.servo]\nangle = [["0 s","0 deg"],["2 s","-50 deg"],["4 s","-5 deg"]]\n'
        'stiffness = "20 N m/rad"\ndamping = "0.1 N m s/rad"\n'
    )
    (shell.folder / "grasp.toml").write_text(scenario, encoding="utf-8")
    shell.run(f"distal simulate grasp.toml --rig hand.toml --out log.csv --seed {seed}")
    assert {"pos1", "cur1"} <= set((shell.folder / "log.csv").read_text().split("\n")[0].split(","))
    (shell.folder / "wanted.csv").write_text(
        "t [s],theta_mcp [deg],theta_pip [deg]\n"
        + "".join(f"{0.01 * k:.2f},{20 + 0.1 * k:.3f},{30 + 0.05 * k:.3f}\n" for k in range(200))
    )
    goes_on(shell, "hand.toml", "log.csv", "theta_mcp")


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.more
def test_a_model_of_mujoco(seed: int, shell: Shell) -> None:
    pytest.importorskip("mujoco")
    from tests.rig.mjcf.models import FINGER

    (shell.folder / "finger.xml").write_text(FINGER, encoding="utf-8")
    identified = shell.run(
        """
        distal rig from-mjcf finger.xml --out finger.toml
        distal rig check finger.toml
        """
    )
    assert "joints" in identified
    # the model says nothing of the sensors' errors, nor of cables that stretch
    assert load_rig(shell.folder / "finger.toml").sensors


@pytest.mark.more  # its estimates: tests/estimators/adaptive/test_adaptive.py
@pytest.mark.parametrize("seed", SEEDS)
def test_the_rig_of_the_paper(seed: int, shell: Shell) -> None:
    """Its plant rubs more than Table 1 says."""
    identified = shell.run(
        f"""
        distal simulate series-2 --out log.csv --seed {seed}
        distal estimate log.csv --rig paper-2008-observed --plot angle.png --findings
        """
    )
    assert rms_of(identified) < rms_of(identified, "inextensible")


@pytest.mark.more
@pytest.mark.parametrize("seed", SEEDS)
def test_a_dataset_of_robot_learning(seed: int, shell: Shell) -> None:
    pytest.importorskip("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    rig = finger_rig()
    text = tomlkit.dumps(plain_value(rig.model_dump(exclude_defaults=True)))
    (shell.folder / "mine.toml").write_text(text, encoding="utf-8")
    data = shell.folder / "dataset" / "data" / "chunk-000"
    data.mkdir(parents=True)
    (shell.folder / "dataset" / "meta").mkdir()
    names = [rig.log.time.column, *(sensor.log_column for sensor in rig.sensors)]
    (shell.folder / "dataset" / "meta" / "info.json").write_text(
        '{"codebase_version": "v2.1", "fps": 100, "features": {}}'
    )
    for i in range(2):
        write_log(finger_log(10 * seed + i, 4.0), rig, shell.folder / f"run_{i}.csv")
        log = read_log(shell.folder / f"run_{i}.csv", rig)
        columns = {
            name: column(shell.folder / f"run_{i}.csv", name)
            for name in names
            if name in (shell.folder / f"run_{i}.csv").read_text().split("\n")[0].split(",")
        }
        columns["episode_index"] = np.full(len(log), i)
        pq.write_table(pa.table(columns), data / f"episode_{i:06d}.parquet")
    (data / "episode_000002.parquet").write_bytes(b"PAR1 half of a file")
    shell.run("distal estimate dataset --rig mine.toml --out estimates")
    for i in range(2):
        assert (shell.folder / "estimates" / f"episode_{i:06d}.csv").is_file()


@pytest.mark.more  # `distal learn`: tests/from_logs/test_learn.py; maps in C: test_learned_maps.py
def test_logs_alone(shell: Shell) -> None:
    """From an archive of logs to live angles and C, with no key of a rig file typed."""
    for path in (Path(__file__).parents[2] / "examples" / "finger_logs").glob("*.csv"):
        lines = path.read_text(encoding="utf-8").splitlines()[:801]
        (shell.folder / path.name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    said = shell.run(
        """
        distal learn run_0.csv run_1.csv run_2.csv --out finger.toml
        distal rig check finger.toml
        distal estimate unseen.csv --rig finger.toml -e adaptive --no-what-if --out estimate.csv \
          --unit rad
        distal stream --rig finger.toml --unit rad < unseen.csv > stream.csv
        distal export-c finger.toml --out firmware --name finger
        """
    )
    assert "wrote finger.toml" in said
    name = "theta"
    offline = column(shell.folder / "estimate.csv", name)
    np.testing.assert_allclose(column(shell.folder / "stream.csv", name), offline, atol=1e-9)
    if COMPILES:
        shell.run(
            f"""
            {sys.executable} {REPLAY} finger.toml finger > firmware/replay.c
            cd firmware
            cc -std=c99 -O2 -fno-math-errno replay.c finger.c -lm -o replay
            ./replay ../unseen.csv > ../replayed.csv
            """
        )
        replayed = column(shell.folder / "replayed.csv", name)
        np.testing.assert_allclose(replayed, offline, atol=1e-7)

"""The command line as a user runs it: what is printed, what is refused, in one line with exit code
2.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from math import degrees, radians
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import distal
import distal_command
from distal.cli import app, main, rig_commands
from distal.errors import EstimationError
from distal.rig import edited_text


class Ran:
    """What a run of the command line gave."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    def call(line: str, *more: object) -> Ran:
        """Run a line as one types it; `more` are words as they are."""
        monkeypatch.setattr(sys, "argv", ["distal", *shlex.split(line), *map(str, more)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as stopped:
            main()
        said = capfd.readouterr()
        code = stopped.value.code
        return Ran(int(code or 0), said.out, said.err)

    return call


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("simulated") / "s2.csv"
    done = CliRunner().invoke(app, ["simulate", "series-2", "--out", str(path), "--seed", "3"])
    assert done.exit_code == 0, done.output
    return path.read_text()


@pytest.fixture
def log(tmp_path: Path, simulated: str) -> Path:
    path = tmp_path / "s2.csv"
    path.write_text(simulated)
    return path


SET = (
    '--rig paper-2008-printed --set \'drives.0.stops=["-5 mm","20 mm"]\' '
    '--set \'drives.1.stops=["-12 mm","13 mm"]\' --set \'joints.0.initial="-25 deg"\''
)


def test_degrees_and_all_states(run, log: Path, tmp_path: Path) -> None:
    """It is what Python estimates; in degrees it is read as a truth again; --all writes every
    state, each with its unit.
    """
    out, every = tmp_path / "est.csv", tmp_path / "every.parquet"
    asked = f"estimate {log} --estimator adaptive {SET}"
    assert run(f"{asked} --out {out}").code == 0
    assert re.search(r"(?m)^ *adaptive +0\.000 ", run(f"{asked} --truth {out}").out)
    assert run(f"{asked} --out {every} --all --unit rad").code == 0
    written = pl.read_parquet(every)
    np.testing.assert_allclose(
        np.deg2rad(pl.read_csv(out)["theta [deg]"]), written["theta [rad]"], atol=1e-12
    )
    rig = distal.load_rig("paper-2008-printed", shlex.split(SET)[3::2])
    angles = distal.estimate(log, rig, "adaptive").theta
    np.testing.assert_allclose(written["theta [rad]"], angles, rtol=1e-15)
    assert {"theta_dot [rad/s]", "theta_dot_std [rad/s]", "friction_left [N]"} <= {*written.columns}
    refused(
        run(f"{asked} --out {out} --unit turns"), "--unit turns: angles are written in rad or deg"
    )


def test_both_sides_of_a_gear(run) -> None:
    """2000 counts in a turn of the motor are 0.18°, behind a gear of 30 they are 0.006°."""
    said = run("""rig check lab-bench --set 'sensors.motor_angle.noise="0.01 deg"'""").out
    assert (
        "motor_angle is before a gear of 30: resolution 0.18° at the motor, 0.006° at the capstan"
        in said
    )
    assert "noise 0.3° at the motor, 0.01° at the capstan" in said


def test_a_check_names_all_that_is_uncertain(run) -> None:
    """What sensors err by and where joints start as well, of one joint and of a hand; not what has
    no std.
    """
    said = run("""rig check template --set 'sensors.u1.gain={ value = 1, std = "1 %" }'""").out
    (uncertain,) = (line for line in said.splitlines() if "uncertain" in line)
    assert "stiffness of all tendons; initial of joint link" in uncertain
    assert uncertain.endswith("linearity of sensors x1, x2; gain of sensor u1")
    bias = 'sensors.index_flexor_current.bias={ value = 0, std = "0.1 N m" }'
    biased = run("rig check hand --set", bias).out
    assert "bias of sensor index_flexor_current" in biased
    assert "gain of sensors thumb_abductor_current, thumb_flexor_current" in biased
    assert "bias" not in run("rig check hand").out


def test_the_command_that_simulate_prints_works(run, tmp_path: Path) -> None:
    log, out, plot = (tmp_path / name for name in ("log.csv", "est.csv", "est.png"))
    said = run(f"simulate series-2 --out {log} --set joints.0.friction.coefficient=0.55").out
    line = said.splitlines()[-1].removeprefix("estimate from it: distal ")
    ran = run(f"{line} --out {out} --plot {plot}")
    assert (ran.code, ran.err) == (0, "")
    assert "800 samples, 0 to 7.99 s, 100 Hz" in ran.out
    assert "truth: column 'true_theta'" in ran.out
    for name in ("inextensible", "elastic"):
        assert name in ran.out
    assert float(ran.out.split(" adaptive ")[1].split()[0]) < 0.6
    frame = pl.read_csv(out)
    assert frame.columns == ["t [s]", "theta [deg]", "theta_std [deg]"]  # as the log has them
    assert frame.height == 800
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_what_the_plant_overrides_is_said(run, tmp_path: Path) -> None:
    scenario, path = tmp_path / "s.toml", "joints.0.friction.coefficient"
    scenario.write_text(f'{run("scenario show series-2").out}\n[plant]\n"{path}" = 0.6\n')
    said = run(f"simulate {scenario} --out {tmp_path / 'log.csv'} --set {path}=0.55").err
    assert "warning: the scenario's [plant] has its own joints.link.friction.coefficient" in said


def test_home_without_a_reference(run, log: Path, tmp_path: Path) -> None:
    """An angle and how far it may be off, in the ways people write it; the angle there is what was
    said.
    """
    bare, out = tmp_path / "bare.csv", tmp_path / "out.csv"
    pl.read_csv(log).select("t", "x1", "x2", "u1", "u2").write_csv(bare)
    command = f"estimate {bare} {SET} --no-what-if --out {out} --homing-angle"
    angle = degrees(pl.read_csv(log)["true_theta"][0])
    for text in (
        f"{angle} deg ± 0.1 deg",
        f"{angle}deg +- 0.1deg",
        f"{radians(angle)} +/- 0.001745",
    ):
        done = run(command, text, "--homing", "0.1s")
        assert re.search(
            r"home: the joint stands at [-\d.]+° ± 0.\d+° for the first 0.1 s", done.out
        )
        assert pl.read_csv(out)["theta [deg]"][8] == pytest.approx(angle, abs=0.3)
    for text, said in (
        ("4 deg ± 1 ± 2", "written as '0 deg'"),
        ("± 1 deg", "written as"),
        ("4 mm", "is no angle"),
    ):
        refused(run(command, text, "--homing", "0.1s"), said)
    refused(run(command, "0 deg"), "give --homing too")


@pytest.mark.slow
def test_gaps_and_missing_values_are_named(run, log: Path, tmp_path: Path) -> None:
    missing = pl.when(pl.col("t") >= 0.055).then("x1").alias("x1")
    frame = pl.read_csv(log).with_columns(missing)
    frame.filter((pl.col("t") < 3) | (pl.col("t") > 3.5)).write_csv(tmp_path / "holed.csv")
    ran = run(f"estimate {tmp_path / 'holed.csv'} {SET}")
    assert "6 missing" in ran.out
    assert "1 gap, the longest 0.52 s at 2.99 s" in ran.out


def refused(ran: Ran, *said: str) -> None:
    assert ran.code == 2
    lines = [line for line in ran.err.splitlines() if not line.startswith("warning:")]
    assert len(lines) == 1, ran.err
    assert lines[0].startswith("error: ")
    assert "Traceback" not in ran.err
    for words in said:
        assert words in lines[0]


def test_bad_input_is_one_line_and_exit_code_2(
    run, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(edited_text("template"))
    before = sorted(tmp_path.iterdir())
    for line, said in (
        (f"estimate {log}", "--rig"),
        (f"estimate {log} --rig template --set drives.0.mass=-1", "left.mass: must be positive"),
        (f"estimate {log} --rig template --truth nothing", "neither a file nor a column"),
        (f"estimate {log} --rig template --out est.xlsx", "results are written as CSV"),
        (f"estimate {log} --rig template --plot a.xyz", "cannot be 'xyz'"),
        (f"estimate {log} --rig lab-bench --out out.csv", "column 'motor_counts' is missing"),
        ("estimate none.csv --rig template", "cannot be read"),
        ("estimate", "'LOG...'"),
        ("simulate series-9 --out log.csv", "unknown scenario"),
        ("simulate mine.toml --out log.csv", "is a rig file; simulate takes what is done to it"),
        ("rig check nothing", "unknown rig"),
        ("nothing", "No such command"),
    ):
        refused(run(line), said)
        assert sorted(tmp_path.iterdir()) == before


def test_rigs(run) -> None:
    listed = run("rigs").out
    for name in distal.shipped_rigs():
        assert name in listed
    assert "15 sub-steps per sample at 100 Hz" in run("rig check paper-2008-printed").out
    path = "joints.0.friction.coefficient=0.4"
    assert run(f"rig show template --set {path}").out == edited_text("template", [path])


def test_scenarios(run, tmp_path: Path) -> None:
    assert "series-2-high" in run("scenarios").out
    (tmp_path / "mine.toml").write_text(run("scenario show series-2").out)
    assert run(f"simulate {tmp_path / 'mine.toml'} --out {tmp_path / 'log.csv'}").code == 0


def test_doctor_says_that_there_is_no_compiler(tmp_path: Path) -> None:
    environment = {**os.environ, "PATH": str(tmp_path), "DISTAL_CACHE": str(tmp_path)}
    environment.pop("CC", None)
    words = [sys.executable, "-m", "distal", "doctor"]
    said = subprocess.run(words, env=environment, capture_output=True, text=True, check=True).stdout
    for text in ("kernel cache: ", "casadi", "C compiler: no C compiler was found"):
        assert text in said


def test_help_and_version(run) -> None:
    assert "Where a tendon-driven joint is" in run("--help").out
    assert run("--version").out == f"distal {distal.__version__}\n"


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
@pytest.mark.slow
def test_an_estimator_that_fails_is_a_row(run, log: Path, tmp_path: Path) -> None:
    """The others are compared and written; where the first fails, they are shown, nothing is
    written, and it ends.
    """
    out = tmp_path / "out.csv"
    wild = pl.col("t").is_between(2.985, 3.015)  # inextensible trusts every sample
    pl.read_csv(log).with_columns(x1=pl.when(wild).then(1000.0).otherwise("x1")).write_csv(log)
    pulleys = " ".join(
        f"""--set "tendons.{i}.insertion={{kind='pulley',radius='9.53 mm'}}" """ for i in (0, 1)
    )
    line = f"estimate {log} --out {out} {SET} {pulleys}"
    ran = run(line)
    assert ran.code == 0, ran.err
    assert re.search(r"inextensible +– +– +– +–", ran.out)
    assert "inextensible: " in ran.out
    assert "left all bounds at 2.99" in ran.out
    out.unlink()
    ran = run(f"{line} -e inextensible -e adaptive")
    refused(ran, "left all bounds")
    assert re.search(r"adaptive +[\d.]+", ran.out)
    assert not out.exists()


@pytest.mark.slow
def test_the_first_steps_fit_each_other(run, tmp_path: Path) -> None:
    """The shipped template reads the log of `simulate template`, with nothing to set."""
    rig, log, again = (tmp_path / name for name in ("mine.toml", "log.csv", "again.csv"))
    rig.write_text(run("rig show template").out)
    run(f"simulate template --out {log}")
    ran = run(f"estimate {log} --rig {rig} -e adaptive --no-what-if")
    assert (ran.code, ran.err) == (0, "")
    assert "consistent" in ran.out
    assert float(re.search(r"adaptive +([\d.]+)", ran.out)[1]) < 0.4  # type: ignore[index]
    run(f"simulate template --rig {rig} --out {again}")
    assert again.read_bytes() == log.read_bytes()


def test_what_goes_wrong_is_one_line(run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of at most 400 characters, without any that a terminal obeys; what is no `DistalError` asks
    for a report.
    """
    loop = tmp_path / "loop.toml"
    loop.symlink_to(loop)
    long = "x" * 400
    for line, *more in (
        ("estimate log.csv --rig", long),
        ("estimate log.csv --rig paper-2008 --out", long),
        ("scenario show", long),
        ("estimate --rig paper-2008", "a\0b"),
        ("estimate --rig paper-2008", "a\x1b[31m" + "b" * 5000),
        ("estimate log.csv --rig", "\0"),
        ("rig check", loop),
        ("rig check paper-2008 --set", "name" + 5000 * ".a" + "=1"),
        ("rig check paper-2008 --set joints.²=1",),
        ("rig check paper-2008 --set", "joints.0\x1b[2J=1"),
        ("estimate --rig paper-2008", loop),
        ("estimate none.csv --rig paper-2008 --truth", "\0"),
    ):
        ran = run(line, *more)
        refused(ran)
        assert "fault of distal" not in ran.err
        assert len(ran.err) <= 401
        assert ran.err.rstrip().isprintable()

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("by\n\x1b[31m" + "x" * 1000)

    monkeypatch.delenv("DISTAL_TRACEBACK")
    monkeypatch.setattr(rig_commands, "table", broken)
    ran = run("rigs")
    assert ran.code == 70
    assert ran.err.startswith("error: ZeroDivisionError: by \\x1b[31mxxx")
    assert ran.err.endswith(
        "this is a fault of distal, please report it with what DISTAL_TRACEBACK=1 distal … prints\n"
    )
    assert len(ran.err) <= 401
    assert ran.err.rstrip().isprintable()


def test_stopped_while_importing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Stopped:
        def __getattr__(self, name: str) -> object:
            raise KeyboardInterrupt

    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setitem(sys.modules, "distal.cli", Stopped())
    with pytest.raises(SystemExit) as ended:
        distal_command.main()
    assert ended.value.code == 130
    assert capsys.readouterr().err == "stopped\n"


def test_stopped_while_casadi_converts() -> None:
    """What is raised in a conversion is lost, as a Ctrl-C once was while a model was built."""
    text = """
import signal, time
import casadi as ca
from distal_command import interrupt

class Pressed:
    def __SX__(self):
        signal.raise_signal(signal.SIGINT)
        return ca.SX(1)

signal.signal(signal.SIGINT, interrupt)
ca.vertcat(ca.SX.sym("x"), Pressed())
for _ in range(500):
    time.sleep(0.01)
"""
    ran = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert "KeyboardInterrupt" in ran.stderr
    assert ran.returncode == -signal.SIGINT


@pytest.mark.slow  # processes of their own
def test_closed_and_full_outputs(tmp_path: Path) -> None:
    """Without a reader the exit code is 141; what is said never goes into the data; a full stderr
    changes no exit code.
    """
    distal = f"'{sys.executable}' -c 'from distal_command import main; main()'"

    def bash(text: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-c", text], capture_output=True, text=True, check=False, cwd=tmp_path
        )

    assert bash(f"({distal} rig show template; echo $? >&2) | true").stderr.split()[-1] == "141"
    assert bash(f"{distal} estimate none.csv --rig template 2>/dev/full").returncode == 2
    closed = bash(f"{distal} estimate none.csv --rig template 2>&-")
    assert (closed.returncode, closed.stdout) == (2, "")
    lines = "t,x1,x2,u1,u2\\n0,0,0,2,2\\n0.01,0,0,2,2\\n"
    assert (
        len(bash(f"printf '{lines}' | {distal} stream --rig template 2>&-").stdout.splitlines())
        == 3
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "said"),
    [
        (TypeError("'NoneType' object is not iterable"), "this is a fault of distal, please"),
        (EstimationError("no filter for this"), "holds: no filter for this"),
    ],
)
def test_a_diagnosis_that_fails_costs_a_line(
    run, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, problem: Exception, said: str
) -> None:
    """The estimate is written, and the command ends well."""

    def broken(*_: object, **__: object) -> None:
        raise problem

    monkeypatch.delenv("DISTAL_TRACEBACK")
    monkeypatch.setattr("distal.diagnosis.diagnose", broken)
    out = tmp_path / "out.csv"
    ran = run(f"estimate {log} --out {out} {SET}")
    assert ran.code == 0
    assert out.stat().st_size > 1000
    (line,) = ran.err.splitlines()
    assert line.startswith("error: testing what the log says of the rig failed; the rest holds: ")
    assert said in line


def test_a_truth_that_ends_with_the_homing_move_is_not_compared_with(run, log: Path) -> None:
    """A temporary encoder, say: no table of nan, no warnings of NumPy."""
    early = pl.when(pl.col("t") < 1.5).then(pl.col("^(true_|encoder).*$")).name.keep()
    pl.read_csv(log).with_columns(early).write_csv(log)
    ran = run(f"estimate {log} --homing 2s {SET}")
    assert ran.code == 0
    assert "nan" not in ran.out + ran.err
    assert "error against truth" not in ran.out
    assert "angle from" in ran.out

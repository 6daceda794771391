"""`distal fit` and homing, as a user runs them."""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import load_rig, read_log, write_log
from tests.cli.test_cli import refused, run  # noqa: F401
from tests.support.plant_and_rig import drawn_plant, logs_of, start_rig, without_truth

RIG = (
    """--rig paper-2008-printed --set 'drives.0.stops=["-5 mm","15 mm"]' """
    """--set 'drives.1.stops=["-5 mm","15 mm"]' --set joints.0.friction.preload.std=0"""
)


FREE = "--free 'tendons.*.stiffness' --free joints.link.friction.coefficient"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder, rig = tmp_path_factory.mktemp("logs"), start_rig()
    plant, _ = drawn_plant(31)
    paths = []
    for i, log in enumerate(logs_of(rig, plant, 31, ("ramps", "servo"), 5.0)):
        paths.append(folder / f"log_{i}.csv")
        write_log(log, rig, paths[-1])
    return paths


@pytest.mark.slow
def test_fit_writes_a_rig_that_the_other_commands_take(
    run, logs: list[Path], tmp_path: Path
) -> None:
    out, again = tmp_path / "fitted.toml", tmp_path / "again.toml"
    ran = run(f"fit {logs[0]} {logs[1]} {RIG} {FREE} --out {out}")
    assert ran.code == 0, ran.err
    for said in (
        "stiffness of all tendons",
        "friction coefficient of joint",
        "N/mm",
        "fitted to 2 logs of 10 s in all",
        "wrote",
    ):
        assert said in ran.out
    assert len(ran.out.splitlines()) <= 25
    text = out.read_text()
    assert text.startswith("# Fitted by `distal fit` to 2 logs of 10 s in all")
    assert "# J, an 84 g disk" in text  # the file's own comments stay
    fitted = load_rig(out)
    assert fitted.tendons[0].stiffness.value != 806.0
    assert fitted.drives[0].stops == (-5e-3, 15e-3)
    assert run(f"estimate {logs[0]} --rig {out}").code == 0
    assert run(f"fit {logs[0]} --rig {out} --no-noise --out {again}").code == 0
    assert again.read_text().count("# Fitted by") == 1


@pytest.mark.slow
def test_a_rig_for_a_simulator_has_no_map(run, logs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "simulator.toml"
    ran = run(f"fit {logs[0]} {logs[1]} {RIG} {FREE} --open-loop --out {out}")
    assert ran.code == 0, ran.err
    assert "answer: with drives as recorded, joints err by" in ran.out
    assert load_rig(out).map is None


@pytest.mark.slow
def test_the_name_of_a_log_does_not_end_a_fit(run, logs: list[Path], tmp_path: Path) -> None:
    """What a fit found is written, whatever the logs are called: half characters, line breaks,
    formulas.
    """
    odd, out = tmp_path / "caf\udce9\n<b>$x^$.csv", tmp_path / "fitted.toml"
    try:
        odd.write_bytes(logs[0].read_bytes())
    except OSError:
        pytest.skip("this file system has no such names")
    free = "joints.link.friction.coefficient"
    ran = run(f"fit {RIG} --free {free} --no-noise --out {out}", odd)
    assert ran.code == 0, ran.err
    assert r"# caf\udce9\n<b>$x^$.csv" in out.read_text().splitlines()


def test_what_cannot_be_fitted_is_one_line_and_nothing_is_written(
    run, logs: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "fitted.toml"
    out.write_text("what stood here")
    for words, said in (
        ("--free 'tendons.*.stifness'", "there is no 'stifness'"),
        ("--groups '(log)'", "at least 2 groups"),
        ("--homing '3 apples'", "apples"),
        ("--homing 30s", "shorter than the log"),
    ):
        refused(run(f"fit {logs[0]} {RIG} --out {out} {words}"), said)
    assert out.read_text() == "what stood here"


def test_homing_uses_the_reference_for_a_while(run, logs: list[Path], tmp_path: Path) -> None:
    ran = run(f"estimate {logs[1]} {RIG} --homing 1s")
    assert ran.code == 0
    assert "used for the first 1 s, compared with afterwards" in ran.out
    assert "contradicts" not in ran.out
    refused(run(f"estimate {logs[1]} {RIG} --homing 99s"), "shorter than the log")
    bare, rig = tmp_path / "bare.csv", start_rig()
    write_log(without_truth(read_log(logs[1], rig)), rig, bare)
    refused(run(f"estimate {bare} {RIG} --homing 1s"), "homing needs")

"""`distal fit` and homing, as a user runs them."""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import load_rig, write_log
from tests.cli.test_cli import Ran, refused, run  # noqa: F401
from tests.support.plant_and_rig import drawn_plant, logs_of, start_rig, without_truth

SET = (
    "--set",
    'drives.0.stops=["-5 mm","15 mm"]',
    "--set",
    'drives.1.stops=["-5 mm","15 mm"]',
    "--set",
    "joints.0.friction.preload.std=0",
)
FREE = ("--free", "tendons.*.stiffness", "--free", "joints.link.friction.coefficient")


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
    out = tmp_path / "fitted.toml"
    ran = run("fit", *logs, "--rig", "paper-2008-printed", *SET, *FREE, "--out", out)
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
    assert (
        "# moment of inertia" in text or "# " in text.split("\n\n", 1)[1]
    )  # the file's own comments stay
    fitted = load_rig(out)
    assert fitted.tendons[0].stiffness.value != 806.0
    assert fitted.drives[0].stops == (-5e-3, 15e-3)
    assert run("estimate", logs[0], "--rig", out).code == 0
    again = tmp_path / "again.toml"
    assert run("fit", logs[0], "--rig", out, "--no-noise", "--out", again).code == 0
    assert again.read_text().count("# Fitted by") == 1


@pytest.mark.slow
def test_a_rig_for_a_simulator_has_no_map(run, logs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "simulator.toml"
    rig = ("--rig", "paper-2008-printed", *SET, *FREE)
    ran = run("fit", *logs, *rig, "--open-loop", "--out", out)
    assert ran.code == 0, ran.err
    assert "answer: with drives as recorded, joints err by" in ran.out
    assert load_rig(out).map is None


@pytest.mark.slow
def test_the_name_of_a_log_does_not_end_a_fit(run, logs: list[Path], tmp_path: Path) -> None:
    """What a fit found is written, whatever the logs are called: half characters, line breaks,
    formulas.
    """
    odd = tmp_path / "caf\udce9\n<b>$x^$.csv"
    try:
        odd.write_bytes(logs[0].read_bytes())
    except OSError:
        pytest.skip("this file system has no such names")
    out = tmp_path / "fitted.toml"
    ran = run(
        "fit",
        odd,
        "--rig",
        "paper-2008-printed",
        *SET,
        "--free",
        FREE[3],
        "--no-noise",
        "--out",
        out,
    )
    assert ran.code == 0, ran.err
    assert r"# caf\udce9\n<b>$x^$.csv" in out.read_text().splitlines()


def test_what_cannot_be_fitted_is_one_line_and_nothing_is_written(
    run, logs: list[Path], tmp_path: Path
) -> None:
    out, rig = tmp_path / "fitted.toml", ("--rig", "paper-2008-printed", *SET)
    out.write_text("what stood here")
    refused(
        run("fit", logs[0], *rig, "--free", "tendons.*.stifness", "--out", out),
        "there is no 'stifness'",
    )
    refused(run("fit", logs[0], *rig, "--out", tmp_path / "fitted.csv"), "a rig file ends in .toml")
    refused(run("fit", logs[0], *rig, "--groups", "(log)", "--out", out), "at least 2 groups")
    refused(run("fit", logs[0], *rig, "--homing", "3 apples", "--out", out), "apples")
    refused(run("fit", logs[0], *rig, "--homing", "30s", "--out", out), "shorter than the log")
    assert out.read_text() == "what stood here"


def test_homing_uses_the_reference_for_a_while(run, logs: list[Path], tmp_path: Path) -> None:
    ran = run(
        "estimate",
        logs[1],
        "--rig",
        "paper-2008-printed",
        *SET,
        "--homing",
        "1s",
        "--out",
        tmp_path / "e.csv",
    )
    assert ran.code == 0
    assert "used for the first 1 s, compared with afterwards" in ran.out
    assert "contradicts" not in ran.out
    rig = start_rig()
    bare = without_truth(logs_of(rig, {}, 31, ("servo",), 3.0)[0])
    write_log(bare, rig, tmp_path / "bare.csv")
    refused(
        run(
            "estimate", tmp_path / "bare.csv", "--rig", "paper-2008-printed", *SET, "--homing", "1s"
        ),
        "homing needs",
    )
    refused(
        run("estimate", logs[1], "--rig", "paper-2008-printed", *SET, "--homing", "99s"),
        "shorter than the log",
    )

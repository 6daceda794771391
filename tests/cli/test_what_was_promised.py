"""Options that do what they say, and wrong files and options that are refused before any work."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import distal
from distal import diagnose, estimate, load_rig, simulate, write_log
from distal.cli.shared_options import table
from distal.logs import Episode, episodes_of
from distal.rig import shipped_rigs
from distal.rig.files import rig_text
from distal.units import rounded
from tests.cli.test_cli import refused, run  # noqa: F401


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    rig = load_rig("paper-2008")
    write_log(simulate("paper-2008", "series-2", seed=1), rig, path)
    return path


def test_without_what_if_nothing_is_run_again(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = load_rig("paper-2008")
    log = simulate(rig, "series-2", seed=1)
    result = estimate(log, rig, compiled=False)

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("the filter ran again")

    monkeypatch.setattr(import_module("distal.diagnosis.diagnose"), "estimator_for", fail)
    assert diagnose(result, log, rig, what_if=False).findings
    with pytest.raises(AssertionError, match="ran again"):
        diagnose(result, log, rig)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--panel", "forces"), "--panel is for one log"),
        (("--findings",), "--findings is for one log"),
        (("--plot", "x.png"), "give one log"),
    ],
)
def test_what_is_for_one_log_is_refused_for_several(
    run, log: Path, tmp_path: Path, words: tuple[str, ...], said: str
) -> None:
    other = tmp_path / "other.csv"
    other.write_bytes(log.read_bytes())
    refused(run("estimate", log, other, "--rig", "paper-2008", *words), said)


def test_smoothing_after_homing_is_refused_before_anything_runs(
    run, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("distal.run.estimate", None)
    words = ("estimate", log, "--rig", "paper-2008", "--smooth", "--homing", "1s")
    refused(run(*words), "--smooth uses the whole log")


@pytest.mark.parametrize("time", ["0 s", "-3s"])
def test_a_homing_time_is_above_zero(run, log: Path, time: str) -> None:
    words = ("estimate", log, "--rig", "paper-2008", "--homing", time)
    refused(run(*words), "--homing is a time above 0 s")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate", "template", "--out"), "a table ends in .csv"),
        (("estimate", "LOG", "--rig", "paper-2008", "--out"), "a table ends in .csv"),
        (("calibrate", "LOG", "--rig", "lab-bench", "--out"), "a rig file ends in .toml"),
    ],
)
def test_no_file_of_another_kind_is_replaced(
    run, log: Path, tmp_path: Path, words: tuple[str, ...], said: str
) -> None:
    mine = tmp_path / "notes.py"
    mine.write_text("mine\n")
    refused(run(*(log if word == "LOG" else word for word in words), mine), said)
    assert mine.read_text() == "mine\n"


def test_smoothing_is_of_adaptive(run, log: Path) -> None:
    words = ("estimate", log, "--rig", "paper-2008", "--smooth", "-e", "elastic")
    refused(run(*words), "--smooth is of adaptive; leave out -e elastic")


@pytest.mark.parametrize(("unit", "factor"), [("deg", np.rad2deg(1.0)), ("rad", 1.0)])
def test_what_is_reached_has_the_unit_of_what_was_asked(
    run, tmp_path: Path, unit: str, factor: float
) -> None:
    desired, out = tmp_path / "wanted.csv", tmp_path / "commands.csv"
    rows = "".join(f"{0.01 * k:.2f},{0.2 * factor * np.sin(k / 50)}\n" for k in range(100))
    desired.write_text(f"t,theta [{unit}]\n{rows}")
    assert run("command", desired, "--rig", "paper-2008", "--out", out).code == 0
    header = out.read_text().splitlines()[0].split(",")
    at = header.index(f"theta [{unit}]")
    reached = np.loadtxt(out, delimiter=",", skiprows=1, usecols=at)
    asked = np.loadtxt(desired, delimiter=",", skiprows=1, usecols=1)
    assert np.abs(reached - asked).max() < 0.01 * factor


def test_the_findings_are_listed(run, log: Path) -> None:
    words = ("estimate", log, "--rig", "paper-2008", "-e", "adaptive")
    brief, full = run(*words), run(*words, "--findings")
    assert len(full.out.splitlines()) > len(brief.out.splitlines())


@pytest.mark.parametrize("name", shipped_rigs())
def test_log_units_are_in_the_order_of_the_live_estimator(name: str) -> None:
    live = distal.LiveEstimator(name, compiled=False)
    assert distal.LogUnits(name).channels == live.channels


@pytest.mark.parametrize("name", shipped_rigs())
def test_a_shipped_rig_names_commands_that_there_are(name: str) -> None:
    known = {"check", "draw", "show", "from-table", "from-orca", "from-mjcf"}
    assert set(re.findall(r"distal rig ([a-z-]+)", rig_text(name)[0])) <= known


def test_fifty_thousand_episodes_are_found_at_once(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from time import process_time

    from pyarrow import parquet

    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text("{}")
    (tmp_path / "data").mkdir()
    parameters = np.arange(50_000)
    parquet.write_table(pa.table({"episode_index": parameters}), tmp_path / "data" / "a.parquet")
    began = process_time()
    found = episodes_of(tmp_path)
    assert process_time() - began < 3.0
    assert found[-1] == Episode(tmp_path / "data" / "a.parquet", 49_999)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (180.4, 2, "180"),
        (0.0351, 2, "0.035"),
        (99.6, 2, "100"),
        (1234.0, 3, "1234"),
    ],
)
def test_large_numbers_have_no_exponent(value: float, digits: int, text: str) -> None:
    assert rounded(value, digits) == text


def test_the_help_of_fit_names_the_formats(run) -> None:
    assert all(name in run("fit", "--help").out for name in ("HDF5", "LeRobot"))


def test_a_long_name_in_a_table_hides_no_number(capsys: pytest.CaptureFixture[str]) -> None:
    """What gives the angle may take a hundred characters; it goes on in the next line."""
    name = "parameters by its equations, with play between drives and tendons and moment arms "
    table("scores", ["what gives the angle", "RMS [°]"], [[2 * name, "0.158"], ["affine", "12.3"]])
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert "0.158" in printed
    assert printed.count("play between drives and tendons") == 2

"""Options that do what they say, and wrong files and options that are refused before any work."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from time import process_time

import numpy as np
import polars as pl
import pytest

import distal
from distal import diagnose, estimate, load_rig, read_log, simulate, write_log
from distal.cli.shared_options import table
from distal.logs import Episode, episodes_of
from distal.rig import shipped_rigs
from distal.rig.files import edited_text
from distal.units import rounded
from tests.cli.test_cli import refused, run  # noqa: F401


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    rig = load_rig("paper-2008")
    write_log(simulate("paper-2008", "series-2", seed=1), rig, path)
    return path


def test_without_what_if_nothing_is_run_again(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = load_rig("paper-2008")
    read = read_log(log, rig)
    result = estimate(read, rig, compiled=False)
    monkeypatch.setattr(import_module("distal.diagnosis.diagnose"), "estimator_for", None)
    assert diagnose(result, read, rig, what_if=False).findings
    with pytest.raises(TypeError, match="not callable"):
        diagnose(result, read, rig)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("OTHER --panel forces", "--panel is for one log"),
        ("OTHER --findings", "--findings is for one log"),
        ("OTHER --plot x.png", "give one log"),
        ("--smooth --homing 1s", "--homing does not go with --smooth"),
        ("--smooth -e elastic", "-e elastic does not go with --smooth: adaptive"),
        ("--homing '0 s'", "--homing is a time above 0 s"),
        ("--homing=-3s", "--homing is a time above 0 s"),
    ],
)
def test_options_that_cannot_be_are_refused_before_anything_runs(
    run, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, said: str
) -> None:
    monkeypatch.setattr("distal.run.estimate", None)
    other = tmp_path / "other.csv"
    other.write_bytes(log.read_bytes())
    refused(run(f"estimate {log} --rig paper-2008 {words.replace('OTHER', str(other))}"), said)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("simulate template", "a table ends in .csv"),
        ("estimate LOG --rig paper-2008", "a table ends in .csv"),
        ("calibrate LOG --rig lab-bench", "a rig file ends in .toml"),
        ("fit LOG --rig paper-2008", "a rig file ends in .toml"),
    ],
)
def test_no_file_of_another_kind_is_replaced(
    run, log: Path, tmp_path: Path, line: str, said: str
) -> None:
    mine = tmp_path / "notes.py"
    mine.write_text("mine\n")
    refused(run(f"{line.replace('LOG', str(log))} --out {mine}"), said)
    assert mine.read_text() == "mine\n"


@pytest.mark.parametrize(("unit", "factor"), [("deg", np.rad2deg(1.0)), ("rad", 1.0)])
def test_what_is_reached_has_the_unit_of_what_was_asked(
    run, tmp_path: Path, unit: str, factor: float
) -> None:
    desired, out = tmp_path / "wanted.csv", tmp_path / "commands.csv"
    time = 0.01 * np.arange(100)
    asked = pl.DataFrame({"t": time, f"theta [{unit}]": 0.2 * factor * np.sin(2 * time)})
    asked.write_csv(desired)
    assert run(f"command {desired} --rig paper-2008 --out {out}").code == 0
    off = pl.read_csv(out)[f"theta [{unit}]"] - asked[f"theta [{unit}]"]
    assert off.abs().max() < 0.01 * factor


def test_the_findings_are_listed(run, log: Path) -> None:
    line = f"estimate {log} --rig paper-2008 -e adaptive"
    assert len(run(f"{line} --findings").out.splitlines()) > len(run(line).out.splitlines())


@pytest.mark.parametrize("name", shipped_rigs())
def test_log_units_are_in_the_order_of_the_live_estimator(name: str) -> None:
    live = distal.LiveEstimator(name, compiled=False)
    assert distal.LogUnits(name).channels == live.channels


@pytest.mark.parametrize("name", shipped_rigs())
def test_a_shipped_rig_names_commands_that_there_are(name: str) -> None:
    known = {"check", "draw", "show", "from-table", "from-orca", "from-mjcf"}
    assert set(re.findall(r"distal rig ([a-z-]+)", edited_text(name))) <= known


def test_fifty_thousand_episodes_are_found_at_once(tmp_path: Path) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text("{}")
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "a.parquet"
    pl.DataFrame({"episode_index": np.arange(50_000)}).write_parquet(path)
    began = process_time()
    assert episodes_of(tmp_path)[-1] == Episode(path, 49_999)
    assert process_time() - began < 3.0


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
    said = run("fit --help").out
    assert all(name in said for name in ("HDF5", "LeRobot"))


def test_a_long_name_in_a_table_hides_no_number(capsys: pytest.CaptureFixture[str]) -> None:
    """What gives the angle may take a hundred characters; it goes on in the next line."""
    name = "parameters by its equations, with play between drives and tendons and moment arms "
    table("scores", ["what gives the angle", "RMS [°]"], [[2 * name, "0.158"], ["affine", "12.3"]])
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert "0.158" in printed
    assert printed.count("play between drives and tendons") == 2

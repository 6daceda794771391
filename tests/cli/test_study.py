"""`distal study` and `distal studies`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import tomlkit
from typer.testing import CliRunner

from distal.cli.app import app, ended_by
from tests.study.plans import RAW

pytest.importorskip("pyarrow")


def test_a_study_becomes_a_page(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(tomlkit.dumps({**RAW, "designs": 3, "name": "Mine"}))
    out = tmp_path / "out"
    for _ in range(2):  # the second time nothing is left to run
        done = CliRunner().invoke(
            app, ["study", str(tmp_path / "mine.toml"), "--out", str(out), "--workers", "1"]
        )
        assert done.exit_code == 0, done.output
    assert done.output.startswith("Without an encoder: ")
    assert json.loads((out / "answer.json").read_text(encoding="utf-8"))["overall"]["rigs"] == 6
    assert sorted(file.name for file in out.iterdir()) == [
        "answer.json",
        "index.html",
        "rows",
        "rows.parquet",
        "study.json",
    ]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["papr", "--out", "{}"],
            "unknown study 'papr'; did you mean 'paper'? (known: finger, lab-bench, paper, "
            "paper-positioned, wrist)",
        ),
        (["paper", "--out", "{}/file"], "cannot be made"),
    ],
)
def test_what_is_wrong_is_one_line_and_exit_code_2(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(app, ["study", *(one.format(tmp_path) for one in arguments)])
    assert done.exception is not None
    assert ended_by(done.exception) == 2
    line = capsys.readouterr().err
    assert said in line
    assert line.count("\n") == 1


def test_shipped_studies_are_listed() -> None:
    done = CliRunner().invoke(app, ["studies"])
    assert done.exit_code == 0
    assert all(name in done.output for name in ("paper", "lab-bench", "finger", "wrist"))

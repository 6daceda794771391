"""`distal study` and `distal studies`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import tomlkit

from tests.cli.test_cli import refused, run  # noqa: F401
from tests.study.plans import RAW

pytest.importorskip("pyarrow")


def test_a_study_becomes_a_page(run, tmp_path: Path) -> None:
    study, out = tmp_path / "mine.toml", tmp_path / "out"
    study.write_text(tomlkit.dumps({**RAW, "designs": 3, "name": "Mine"}))
    for _ in range(2):  # the second time nothing is left to run
        done = run(f"study {study} --out {out} --workers 1")
        assert done.code == 0, done.err
    assert done.out.startswith("Without an encoder: ")
    assert json.loads((out / "answer.json").read_text(encoding="utf-8"))["overall"]["rigs"] == 6
    names = ["answer.json", "index.html", "rows", "rows.parquet", "study.json"]
    assert sorted(file.name for file in out.iterdir()) == names


def test_what_is_wrong_is_one_line_and_exit_code_2(run, tmp_path: Path) -> None:
    said = "unknown study 'papr'; did you mean 'paper'? (known: finger, lab-bench, paper, "
    refused(run(f"study papr --out {tmp_path}"), said)
    (tmp_path / "file").touch()
    refused(run(f"study paper --out {tmp_path / 'file'}"), "cannot be made")


def test_shipped_studies_are_listed(run) -> None:
    listed = run("studies").out
    assert all(name in listed for name in ("paper", "lab-bench", "finger", "wrist"))

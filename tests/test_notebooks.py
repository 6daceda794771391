"""The notebooks of `examples/` run from their first cell to their last, and show what they hold."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib
import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples").glob("*.ipynb"))


def cells(path: Path, kind: str) -> list[dict]:
    return [
        cell
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        if cell["cell_type"] == kind
    ]


@pytest.mark.more
@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    names: dict[str, object] = {}
    for cell in cells(path, "code"):
        lines = [line for line in "".join(cell["source"]).splitlines() if not line.startswith("%")]
        exec(compile("\n".join(lines), path.name, "exec"), names)


def test_notebooks_are_there_with_figures_and_without_errors() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["command", "finger", "first_estimate"]
    for path in NOTEBOOKS:
        outputs = [output for cell in cells(path, "code") for output in cell["outputs"]]
        assert not any(output["output_type"] == "error" for output in outputs)
        assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2

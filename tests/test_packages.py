"""Each package says what goes in and out, with an example that runs."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from textwrap import dedent

import matplotlib
import pytest

PACKAGES = sorted(
    path.parent.name
    for path in (Path(__file__).parents[1] / "src" / "distal").glob("*/__init__.py")
)
ELSEWHERE = {"codegen": "its docstring is of its modules: from a function to C"}


@pytest.mark.parametrize("package", [name for name in PACKAGES if name not in ELSEWHERE])
def test_the_example_of_a_package_runs(
    package: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = import_module(f"distal.{package}").__doc__ or ""
    assert re.search(r"(?m)^In: ", text)
    assert re.search(r"\bout: ", text)
    code = dedent("    " + text.split("\n\n    ", 1)[1])
    assert len(code.strip().splitlines()) <= 12
    monkeypatch.chdir(tmp_path)
    matplotlib.use("agg")
    exec(compile(code, package, "exec"), {})
    assert capsys.readouterr().out.strip()

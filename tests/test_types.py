"""What type checkers see: no `Any` in public signatures, and a user's own code passes with all
checks on.
"""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tools.untyped import found, problems, reasons, untyped

import distal
from distal.results.plots import PlotOptions

PACKAGE = Path(distal.__file__).parent
README = Path(__file__).parents[1] / "README.md"


def test_what_hides_a_type_has_a_reason() -> None:
    """A friction that was not there went through `getattr` with a variable name unseen."""
    assert problems(found(), reasons()) == []
    text = """
from typing import Any, cast
VALUES: dict[str, Any] = {}
class Rig:
    def of(self, kind, name):
        first = getattr(self, kind)
        return getattr(first, "name"), cast(int, name)
"""
    there = list(untyped(text))
    assert there == ["module Any", "Rig.of getattr", "Rig.of cast"]
    assert problems(there, {"module Any": "a table", "Rig.of cast": ""}) == [
        "Rig.of getattr: say its type, or why not",
        "Rig.of cast: say its type, or why not",
    ]
    assert problems([], {"gone Any": "a reason"}) == ["gone Any: is not there"]


def test_a_plot_has_the_options_that_its_type_names() -> None:
    accepted = inspect.signature(distal.plot_estimates).parameters
    assert list(PlotOptions.__annotations__) == [
        name for name in accepted if name not in ("estimates", "path")
    ]


MISTAKES = (
    'import distal\n\nrig = distal.load_rig("template")\n'
    "distal.estimate(3, rig)\n"
    'distal.estimate("log.csv", rig).plot(panel=["innovations"])\n'
    'distal.estimate("log.csv", rig).angles.nonsense\n'
)


@pytest.mark.more
@pytest.mark.slow
def test_a_users_type_check_passes_the_readme_and_sees_mistakes(tmp_path: Path) -> None:
    """In a folder with no settings; a package whose types were not found would let everything
    pass.
    """
    pytest.importorskip("mypy", reason="the extra 'dev' is not installed")
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    assert blocks
    (tmp_path / "readme.py").write_text("\n".join(blocks), encoding="utf-8")
    (tmp_path / "mistakes.py").write_text(MISTAKES, encoding="utf-8")
    paths = os.pathsep.join(filter(None, [str(PACKAGE.parent), os.environ.get("PYTHONPATH")]))
    words = ["--strict", "--config-file", os.devnull, "readme.py", "mistakes.py"]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    said = done.stdout.splitlines()
    assert said[-1].endswith("(checked 2 source files)")
    assert not [line for line in said if line.startswith("readme.py")]
    errors = [line for line in said if line.startswith("mistakes.py") and ": error:" in line]
    assert {line.split(":")[1] for line in errors} == {"4", "5", "6"}

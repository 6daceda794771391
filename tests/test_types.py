"""What type checkers see: no `Any` in public signatures, and a user's own code passes with all
checks on.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tools.untyped import found, problems, reasons, untyped

import distal
from distal.results.plots import PlotOptions

PACKAGE = Path(distal.__file__).parent
README = Path(__file__).parents[1] / "README.md"


def public_annotations(body: list[ast.stmt], path: str) -> Iterator[tuple[str, ast.expr]]:
    """Yield path and annotation of all that is public: arguments, results, fields, of classes
    within too.
    """
    for node in body:
        name = getattr(node, "name", "")
        if name.startswith("_") and not name.endswith("__"):
            continue
        if isinstance(node, ast.ClassDef):
            yield from public_annotations(node.body, f"{path}.{name}")
        elif isinstance(node, ast.FunctionDef):
            arguments = node.args
            every = [
                *arguments.posonlyargs,
                *arguments.args,
                arguments.vararg,
                *arguments.kwonlyargs,
                arguments.kwarg,
            ]
            annotated = [each.annotation for each in every if each is not None] + [node.returns]
            yield from ((f"{path}.{name}", each) for each in annotated if each is not None)
        elif (
            isinstance(node, ast.AnnAssign)
            and isinstance(node.target, ast.Name)
            and node.target.id[0] != "_"
        ):
            yield f"{path}.{node.target.id}", node.annotation


def test_no_public_signature_has_any() -> None:
    """`Any` tells neither a reader nor a type checker what a value is."""
    found, seen = [], 0
    for file in sorted(PACKAGE.rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for path, annotation in public_annotations(tree.body, str(file.relative_to(PACKAGE))):
            seen += 1
            if any(
                isinstance(node, ast.Name) and node.id == "Any" for node in ast.walk(annotation)
            ):
                found.append(f"{path}: {ast.unparse(annotation)}")
    assert seen > 1000
    assert not found


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


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return what a user's mypy says of the README's code and of mistakes, in a folder with no
    settings.
    """
    pytest.importorskip("mypy", reason="the extra 'dev' is not installed")
    folder = tmp_path_factory.mktemp("user")
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    assert blocks
    (folder / "readme.py").write_text("\n".join(blocks), encoding="utf-8")
    (folder / "mistakes.py").write_text(MISTAKES, encoding="utf-8")
    paths = os.pathsep.join(filter(None, [str(PACKAGE.parent), os.environ.get("PYTHONPATH")]))
    words = ["--strict", "--config-file", os.devnull, "readme.py", "mistakes.py"]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return done.stdout.splitlines()


@pytest.mark.more
@pytest.mark.slow
def test_the_code_of_the_readme_passes_a_users_type_check(said: list[str]) -> None:
    assert said[-1].endswith("(checked 2 source files)")
    assert not [line for line in said if line.startswith("readme.py")]


@pytest.mark.more
@pytest.mark.slow
def test_a_users_type_check_sees_mistakes(said: list[str]) -> None:
    """A package whose types were not found would let everything pass."""
    errors = [line for line in said if line.startswith("mistakes.py") and ": error:" in line]
    assert {line.split(":")[1] for line in errors} == {"4", "5", "6"}

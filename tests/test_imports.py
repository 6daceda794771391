"""Imports: no circles, so that a module can be read with only those below it; and nothing heavy
before it is needed.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import distal


def with_packages(module: str) -> set[str]:
    """Return a module and the packages that it lies in."""
    parts = module.split(".")
    return {".".join(parts[: i + 1]) for i in range(len(parts))}


def test_no_module_imports_itself_through_others() -> None:
    """At the top, inside functions and for types alike.

    To import ``a.b.c`` is to run ``a``, ``a.b`` and ``a.b.c``, so it counts as an import of all
    three, but for the packages that the importing module lies in: they are being imported already.
    A package that a module names itself (``from a.b import name`` inside ``a.b``) does count.
    """
    grimp = pytest.importorskip("grimp", reason="the extra 'dev' is not installed")
    graph = grimp.build_graph("distal", cache_dir=None)
    direct = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    for module, imported in direct.items():
        for package in set().union(*map(with_packages, imported)) - with_packages(module):
            graph.add_import(importer=module, imported=package)
    assert len(direct) > 100, "the package was not read"
    assert [
        f"{module} imports {other}"
        for module, imported in direct.items()
        for other in imported
        if graph.chain_exists(importer=other, imported=module)
    ] == []


def test_no_test_needs_a_benchmark() -> None:
    """What both need is in `tests/support`; the benchmarks' own tools are tested beside them."""
    folder = Path(__file__).parent
    files = list(folder.rglob("*.py"))
    assert len(files) > 100, "the tests were not read"
    needing = [
        path.name
        for path in files
        if re.search(r"(?m)^ *(from|import) benchmarks\b", path.read_text(encoding="utf-8"))
    ]
    assert needing == []


HEAVY = (
    "numpy",
    "casadi",
    "scipy",
    "pydantic",
    "pint",
    "matplotlib",
    "pandas",
    "polars",
    "pyarrow",
)


@pytest.mark.parametrize("start", ["import distal", "import distal.cli"])
def test_starting_is_light(start: str) -> None:
    """What `import distal` and `distal --help` do not need is not imported; nobody needs typer for
    `import distal`.
    """
    heavy = (*HEAVY, "typer") if start == "import distal" else HEAVY
    ran = subprocess.run(
        [
            sys.executable,
            "-c",
            f"{start}; import sys; print([name for name in {heavy} if name in sys.modules])",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout.strip() == "[]"


def test_every_public_name_is_found() -> None:
    """At run time as a type checker finds it: from the same package, and listed by `dir`."""
    tree = ast.parse(Path(distal.__file__).read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    packages = {alias.name: node.module or "" for node in imports for alias in node.names}
    for name in distal.__all__:
        assert getattr(distal, name) is getattr(import_module(packages[name]), name)
    code = "import distal; print(*dir(distal))"
    listed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert set(listed) >= set(distal.__all__)
    with pytest.raises(AttributeError, match="'distal' has no attribute 'estimat'"):
        distal.estimat  # noqa: B018

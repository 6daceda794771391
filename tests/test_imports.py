"""Imports: no circles, so that a module can be read with only those below it; and nothing heavy
before it is needed.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path

import pytest

import distal

Graph = dict[str, set[str]]


def import_graph(folder: Path) -> Graph:
    """Return which modules each module of a package imports: at the top, inside functions and for
    types alike.

    To import ``a.b.c`` is to run ``a``, ``a.b`` and ``a.b.c``, so it counts as an import of all
    three, but for the packages that the importing module lies in: they are being imported already.
    A package that a module names itself (``from a.b import name`` inside ``a.b``) does count.

    Args:
        folder: of the package.
    """
    files = {}
    for path in folder.rglob("*.py"):
        parts = (folder.name, *path.relative_to(folder).with_suffix("").parts)
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in files.items()}
    bound = {name: set(names_bound(tree)) for name, tree in trees.items()}
    graph: Graph = {}
    for name, tree in trees.items():
        is_package = files[name].name == "__init__.py"
        around = with_packages(name)
        graph[name] = set()
        for target in targets(tree, name, is_package, bound):
            graph[name] |= (with_packages(target) - around | {target}) & files.keys() - {name}
    return graph


def with_packages(module: str) -> set[str]:
    """Return a module and the packages that it lies in."""
    parts = module.split(".")
    return {".".join(parts[: i + 1]) for i in range(len(parts))}


def names_bound(tree: ast.Module) -> Iterator[str]:
    """Yield the names that the imports of a module bind in it."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield from (alias.asname or alias.name for alias in node.names)


def targets(
    tree: ast.Module, name: str, is_package: bool, bound: Mapping[str, set[str]]
) -> Iterator[str]:
    """Yield what a module imports.

    Args:
        tree: of the importing module.
        name: of the importing module.
        is_package: whether it is a package's ``__init__``.
        bound: the names that the imports of each module of the package bind.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parts = name.split(".") if node.level else []
            parts = parts[: len(parts) - node.level + is_package] if node.level else parts
            base = ".".join([*parts, *([node.module] if node.module else [])])
            for alias in node.names:
                submodule = f"{base}.{alias.name}"
                if submodule in bound:
                    yield submodule
                # `from a import b` takes what a's own imports call b, and only otherwise the module
                # a.b
                if submodule not in bound or alias.name in bound.get(base, ()):
                    yield base


def circles(graph: Graph) -> set[frozenset[str]]:
    """Return the strongly connected components of more than one module, or of one that imports
    itself.
    """
    reach = {module: reachable(graph, module) for module in graph}
    found = (
        frozenset(other for other in reach[module] if module in reach[other]) for module in graph
    )
    return {circle for circle in found if circle}


def reachable(graph: Graph, start: str) -> set[str]:
    """Return every module that a module imports, directly or through others."""
    seen: set[str] = set()
    waiting = list(graph[start])
    while waiting:
        module = waiting.pop()
        if module not in seen:
            seen.add(module)
            waiting += graph[module]
    return seen


def imports_within(graph: Graph, circle: frozenset[str]) -> str:
    return ", ".join(f"{a} imports {b}" for a in sorted(circle) for b in sorted(graph[a] & circle))


def test_no_module_imports_itself_through_others() -> None:
    graph = import_graph(Path(distal.__file__).parent)
    found = circles(graph)
    assert len(graph) > 100, "the package was not read"
    assert [imports_within(graph, circle) for circle in found] == []


def package(folder: Path, sources: Mapping[str, str]) -> Path:
    """Write a package named ``made`` of the given modules; those not given are empty."""
    for name, source in sources.items():
        path = folder / "made" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source, encoding="utf-8")
    for inner in [
        folder / "made",
        *(path for path in (folder / "made").rglob("*") if path.is_dir()),
    ]:
        (inner / "__init__.py").touch()
    return folder / "made"


@pytest.mark.parametrize(
    ("sources", "circle"),
    [
        pytest.param(
            {"a.py": "import made.b", "b.py": "from made.a import x"},
            {"made.a", "made.b"},
            id="at the top",
        ),
        pytest.param(
            {"a.py": "from made.b import y", "b.py": "def f():\n    from made.a import x"},
            {"made.a", "made.b"},
            id="inside a function",
        ),
        pytest.param(
            {
                "a.py": "from made.b import y",
                "b.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from made.a "
                "import x",
            },
            {"made.a", "made.b"},
            id="for types only",
        ),
        pytest.param(
            {
                "a.py": "from made import b",
                "b.py": "from made import c",
                "c.py": "from .a import x",
            },
            {"made.a", "made.b", "made.c"},
            id="of three, submodules and relative",
        ),
        pytest.param(
            {
                "p/__init__.py": "from made.p.a import x",
                "p/a.py": "from made.q import y",
                "q.py": "from made.p import x",
            },
            {"made.p", "made.p.a", "made.q"},
            id="through a re-export",
        ),
        pytest.param(
            {
                "p/__init__.py": "from made.p.a import x",
                "p/a.py": "import made.q.b",
                "p/c.py": "",
                "q/b.py": "from made.p.c import z",
            },
            {"made.p", "made.p.a", "made.q.b"},
            id="through a package that runs first",
        ),
        pytest.param(
            {
                "p/__init__.py": "from made.p.a import a",
                "p/a.py": "",
                "p/b.py": "from made.p import a",
            },
            set(),
            id="none: a package does not import all its modules",
        ),
        pytest.param(
            {
                "p/__init__.py": "from .a import x\nfrom .b import y",
                "p/a.py": "",
                "p/b.py": "from . import x",
            },
            {"made.p", "made.p.b"},
            id="the own package",
        ),
        pytest.param(
            {
                "p/__init__.py": "from .a import x\nfrom .b import y",
                "p/a.py": "",
                "p/b.py": "from made.p import a",
            },
            set(),
            id="none: a module of the own package",
        ),
        pytest.param(
            {
                "p/__init__.py": "from .a import a\nfrom .b import y",
                "p/a.py": "",
                "p/b.py": "from made.p import a",
            },
            {"made.p", "made.p.b"},
            id="the own package, where a name hides a module",
        ),
        pytest.param(
            {
                "a.py": "import json\nfrom made.b import y",
                "b.py": "import os",
                "c.py": "from made.a import x",
            },
            set(),
            id="none: a chain",
        ),
    ],
)
def test_circles_are_seen(tmp_path: Path, sources: dict[str, str], circle: set[str]) -> None:
    found = circles(import_graph(package(tmp_path, sources)))
    assert found == ({frozenset(circle)} if circle else set())


def test_no_test_needs_a_benchmark() -> None:
    """What both need is in `tests/support`; the benchmarks' own tools are tested beside them."""
    folder = Path(__file__).parent
    files = list(folder.rglob("*.py"))
    assert len(files) > 100, "the tests were not read"
    needing = {
        path.relative_to(folder).as_posix()
        for path in files
        for target in targets(ast.parse(path.read_text(encoding="utf-8")), "", False, {})
        if target.partition(".")[0] == "benchmarks"
    }
    assert needing == set()


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

"""The test files that a change touches, which `make test-changed` runs.

    python -m tools.changed [SINCE]

A file is touched where it was changed itself, imports a module that was, or, where those are few, a
module that imports such a one. Names of `distal` itself stand for the modules that they come from.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]

FEW = 12
"""So many test files run in seconds: beyond them only those that import the change itself do."""


def changed_files(since: str) -> list[Path]:
    """Return the files that differ from a commit, new ones included, relative to the project."""
    commands = (
        ["git", "diff", "--name-only", since],
        ["git", "ls-files", "--others", "--exclude-standard"],
    )
    lines = (
        subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for words in commands
    )
    return [Path(line) for text in lines for line in text.splitlines()]


def module_of(path: Path) -> str:
    """Return the module that a file is."""
    parts = path.with_suffix("").parts
    parts = parts[1:] if parts[0] == "src" else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Return the modules that a file imports, wherever in it, and the names from modules."""
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{name.name}" for name in node.names}
    return frozenset(names)


def sources_of(folder: Path) -> dict[str, Path]:
    """Return module → file of all modules below a folder."""
    return {module_of(path.relative_to(ROOT)): path for path in folder.rglob("*.py")}


def touched_tests(changed: set[str]) -> list[Path]:
    """Return the test files that changed modules touch, in their order."""
    sources = sources_of(ROOT / "src" / "distal")
    tests = sources_of(ROOT / "tests") | sources_of(ROOT / "benchmarks" / "tests")
    reexported = _reexports(sources)

    def modules(path: Path) -> set[str]:
        names = {reexported.get(name, name) for name in imports_of(path)}
        return {name if name in {**sources, **tests} else name.rpartition(".")[0] for name in names}

    direct = {path for name, path in tests.items() if name in changed or modules(path) & changed}
    users = {name for name, path in sources.items() if modules(path) & changed}
    indirect = direct | {path for path in tests.values() if modules(path) & users}
    chosen = indirect if len(indirect) <= FEW else direct
    return sorted(path for path in chosen if path.name.startswith("test_"))


def _reexports(sources: dict[str, Path]) -> dict[str, str]:
    """Return the public name in a package → the module that it comes from."""
    found: dict[str, str] = {}
    packages = [name for name, path in sources.items() if path.name == "__init__.py"]
    for package in sorted(packages, key=len, reverse=True):
        for name in imports_of(sources[package]):
            module = found.get(name, name.rpartition(".")[0])
            found[f"{package}.{name.rpartition('.')[2]}"] = module
    return found


def main() -> None:
    """Print the files, one a line."""
    since = sys.argv[1] if len(sys.argv) > 1 else "HEAD"
    changed = {module_of(path) for path in changed_files(since) if path.suffix == ".py"}
    for path in touched_tests(changed):
        print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()

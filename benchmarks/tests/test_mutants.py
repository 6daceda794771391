"""The tool that makes mistakes on purpose: where it makes them, and that it says truly whether the
tests saw them.
"""

from __future__ import annotations

import sys
import textwrap
import time
from pathlib import Path

import pytest

from benchmarks import copies, mutants
from benchmarks.mutations import Mutant, every_mutant, positions

FILE = Path("small.py")


def text(code: str) -> str:
    return textwrap.dedent(code).lstrip()


def changes(code: str) -> set[str]:
    """Return what one line of code can become."""
    return {each.after for each in every_mutant(FILE, text(code))}


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("x = a + b", {"x = a - b", "x = -a + b"}),
        ("x = a * b", {"x = a / b", "x = -a * b"}),
        ("x = -a", {"x = a"}),
        ("x += a", {"x -= a"}),
        ("x = a < b", {"x = a <= b", "x = a > b"}),
        ("x = a == b", {"x = a != b"}),
        ("x = a and b", {"x = a or b"}),
        ("x = ca.fmin(a, b)", {"x = ca.fmax(a, b)"}),
        ("x = ca.cos(a)", {"x = ca.sin(a)"}),
        ("x = ca.if_else(a, b, f(c))", {"x = ca.if_else(a, f(c), b)"}),
        ("x = 0.5", {"x = 0.525", "x = 0.475", "x = 1"}),
        ("x = 0.0", {"x = 1.0"}),
        ("x = 3", {"x = 4", "x = 3.15", "x = 2.85", "x = 6"}),
        ("COUNT = 3", {"COUNT = 4"}),
        ("x = y[3]", {"x = y[4]"}),
        ("x = y[a:b]", {"x = y[a + 1:b]", "x = y[a - 1:b]", "x = y[a:b + 1]", "x = y[a:b - 1]"}),
    ],
)
def test_each_kind_of_change(code: str, expected: set[str]) -> None:
    assert changes(code) == expected


@pytest.mark.parametrize(
    "code",
    [
        "from a import b2",
        "__all__ = ['a' + 'b']",
        "assert a < 3",
        "x: tuple[int, 3] = y",
        "def f(a: Literal[1] = z, *, b: str = 'less') -> Literal[2]:\n    '''1 + 2 < 3.'''",
        "@lru_cache(maxsize=16)\ndef f():\n    pass",
        "warn('old', stacklevel=2)",
        "x = [a] + [b]",
        "x = 'a' + b",
        "x = a == 'b'",
        "x = f'{a + 1}'",
        "x = True",
        "x = ca.if_else(a, b, b)",
        "x = a is None",
    ],
)
def test_what_is_left_alone(code: str) -> None:
    assert positions(text(code)) == []


def test_branches_over_several_lines() -> None:
    code = text("""
        x = ca.if_else(
            a,
            b,  # one
            c,
        )
    """)
    (each,) = every_mutant(FILE, code)
    assert each.text == code.replace("b,", "?,").replace("c,", "b,").replace("?,", "c,")
    assert (each.line, each.before, each.after) == (3, "b,  # one ⏎ c,", "c,  # one ⏎ b,")


def test_the_same_seed_gives_the_same_mutants() -> None:
    files = mutants.modules(mutants.ROOT)
    assert files == sorted(set(files))
    one, same, other = (mutants.drawn(mutants.ROOT, files, 20, seed) for seed in (1, 1, 2))
    assert one == same
    assert one != other
    assert len({(each.file, each.text) for each in one}) == 20


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small project: a module, a test that sees one of its functions, and one with a stored
    value.
    """
    monkeypatch.setenv(
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1"
    )  # plugins take longer than these tests
    root = tmp_path / "project"
    for folder in ("src/distal/estimators", "tests/estimators", ".git"):
        (root / folder).mkdir(parents=True)
    (root / "src/distal/__init__.py").write_text("")
    (root / "src/distal/estimators/kinematic.py").write_text(
        "def gain(p, r):\n    return p / (p + r)\n\n\ndef unused(a):\n    return a < 3\n\n\ndef "
        "down(n):\n"
        "    while n:\n        n -= 1\n"
    )
    (root / "tests/estimators/test_gain.py").write_text(
        "import pytest\nfrom distal.estimators.kinematic import down, gain, unused\n\n\n"
        "def test_gain():\n    down(3)\n    assert gain(1.0, 3.0) == 0.25\n\n\n"
        "@pytest.mark.stored\ndef test_stored():\n    assert unused(2)\n"
    )
    (root / "pyproject.toml").write_text(
        "[tool.pytest.ini_options]\nmarkers = ['slow', 'more', 'stored']\naddopts = '-ra "
        "--strict-markers'\n"
    )
    return root


def made(project: Path, before: str, after: str) -> Mutant:
    file = Path("src/distal/estimators/kinematic.py")
    source = (project / file).read_text()
    (found,) = (
        each for each in every_mutant(file, source) if (each.before, each.after) == (before, after)
    )
    return found


@pytest.mark.slow
def test_seen_and_survived(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tried = [
        made(project, "return p / (p + r)", "return p / (p - r)"),
        made(project, "return a < 3", "return a > 3"),
        made(project, "return p / (p + r)", "return p * (p + r)"),
    ]
    before = sorted(project.rglob("*"))
    outcomes = mutants.run(tried, 1, project)
    assert [outcome.seen for outcome in outcomes] == [
        True,
        False,
        True,
    ]  # what only a stored value sees does not count
    assert outcomes[0].by == "tests/estimators/test_gain.py::test_gain"
    said = mutants.report(tried, outcomes)
    assert "kinematic.py" in said
    assert "kinematic.py:6 (operator)\n    - return a < 3\n    + return a > 3" in said
    assert "(67 %)" in said
    assert "[3/3" in capsys.readouterr().out
    assert sorted(path for path in project.rglob("*") if "__pycache__" not in path.parts) == before


def test_a_copy_that_fails_is_said(project: Path) -> None:
    (project / "tests/estimators/test_gain.py").write_text("def test_wrong():\n    assert False\n")
    with pytest.raises(
        copies.BaselineError, match=r"unchanged copy fails: .*test_gain.py::test_wrong"
    ):
        mutants.run([], 1, project)


def test_a_hang_is_seen_and_ended() -> None:
    processes = copies.Processes()
    code = (
        "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; "
        "time.sleep(60)'])"
    )
    started = time.monotonic()
    said = processes.run([sys.executable, "-c", code], Path(), {}, 0.5)
    assert time.monotonic() - started < 20
    assert copies.first_failure(*said) == "time-out: the tests hang"

"""The tool that makes mistakes on purpose: where it makes them, and that it says truly whether the
tests saw them.
"""

from __future__ import annotations

import ast
import sys
import textwrap
import time
from pathlib import Path

import pytest

from benchmarks import copies, mutants
from benchmarks.mutations import Mutant, every_mutant, mutant, positions

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
        ("x = (a) - (b)  # a + b", {"x = (a) + (b)  # a + b", "x = (-a) - (b)  # a + b"}),
        ("x = a * b", {"x = a / b", "x = -a * b"}),
        ("x = c() - a / b", {"x = c() + a / b", "x = -c() - a / b", "x = c() - a * b"}),
        ("x = -a", {"x = a"}),
        ("x += a", {"x -= a"}),
        ("x *= a", {"x /= a"}),
        ("x = a < b", {"x = a <= b", "x = a > b"}),
        (
            "x = a > b >= c",
            {"x = a >= b >= c", "x = a < b >= c", "x = a > b > c", "x = a > b <= c"},
        ),
        ("x = a == b", {"x = a != b"}),
        ("x = a and b", {"x = a or b"}),
        ("x = a or b or c", {"x = a and b or c", "x = a or b and c"}),
        ("x = ca.fmin(a, b)", {"x = ca.fmax(a, b)"}),
        ("x = ca.cos(a)", {"x = ca.sin(a)"}),
        ("x = max(a, b)", {"x = min(a, b)"}),
        ("x = ca.logic_and(a, b)", {"x = ca.logic_or(a, b)"}),
        ("x = ca.if_else(a, b, f(c))", {"x = ca.if_else(a, f(c), b)"}),
        ("x = 0.5", {"x = 0.525", "x = 0.475", "x = 1"}),
        ("x = 0.0", {"x = 1.0"}),
        ("x = 1.0", {"x = 0.0", "x = 1.05", "x = 0.95", "x = 2.0"}),
        ("x = 0", {"x = 1"}),
        ("x = 1", {"x = 0", "x = 2", "x = 1.05", "x = 0.95"}),
        ("x = 3", {"x = 4", "x = 3.15", "x = 2.85", "x = 6"}),
        ("COUNT = 3", {"COUNT = 4"}),
        ("x = y**2", {"x = y**3"}),
        ("x = y[3]", {"x = y[4]"}),
        ("x = y[a, 0]", {"x = y[a, 1]"}),
        ("x = range(3)", {"x = range(4)"}),
        ("x = (3, a)", {"x = (4, a)"}),
        ("x = y[a:b]", {"x = y[a + 1:b]", "x = y[a - 1:b]", "x = y[a:b + 1]", "x = y[a:b - 1]"}),
        ("x = y[:40]", {"x = y[:41]", "x = y[:39]"}),
    ],
)
def test_each_kind_of_change(code: str, expected: set[str]) -> None:
    assert changes(code) == expected


@pytest.mark.parametrize(
    "code",
    [
        "from a import b2",
        "__all__ = ['a' + 'b']",
        "raise ValueError(f'{a + 1} is more than {2 * b}', 3 < 4)",
        "assert a < 3",
        "x: tuple[int, 3] = y",
        "def f(a: Literal[1] = z, *, b: str = 'less') -> Literal[2]:\n    '''1 + 2 < 3.'''",
        "@lru_cache(maxsize=16)\ndef f():\n    pass",
        "class A(make(1)):\n    '''0.5.'''\n    a: Literal[3]",
        "x = cast(tuple[int, 3], y)",
        "x = tuple[int, 3]",
        "warn('old', stacklevel=2)",
        "x = [a] + [b]",
        "x = [a] * n",
        "x = [*a, b] + c",
        "x = 'a' + b",
        "x += [a]",
        "x = a == 'b'",
        "x = f'{a + 1}'",
        "x = True",
        "x = ca.if_else(a, b, b)",
        "x = a is None",
    ],
)
def test_what_is_left_alone(code: str) -> None:
    assert positions(text(code)) == []


def test_what_changes_nothing_is_no_change() -> None:
    """x + 0 is x − 0, and x * 1 is x / 1: only the numbers and signs beside are changed."""
    assert "x = a - 0" not in changes("x = a + 0")
    assert "x = a / 1" not in changes("x = a * 1")


SMALL = text('''
    """A module: 1 + 2 < 3, µ = 0.5."""

    from math import cos

    LIMIT = 0.5  # µ is 0.5


    def pull(tension: float, µ: float = 0.25) -> float:
        """Return T (1 − µ) * 2."""
        first = (  # θ, with a comment * of its own
            tension  # θ
            # +
            * (1 - µ)
        )
        if first < LIMIT and tension > 0.0:
            return cos(first)
        values = [first, -tension][0:1]
        if tension == 7:
            raise ValueError(f"{tension} + 1 < 2")
        return sum(values)
''')


def test_exactly_the_place_is_replaced() -> None:
    """Bytes before and after stay, also behind letters that take several; every change parses and
    differs.
    """
    tree = ast.dump(ast.parse(SMALL))
    data = SMALL.encode()
    found = positions(SMALL)
    assert {position.kind for position in found} == {"sign", "operator", "constant", "bound"}
    for position in found:
        assert data[position.start : position.end].decode() == position.before
    for each in every_mutant(FILE, SMALL):
        assert ast.dump(ast.parse(each.text)) != tree
        assert [a == b for a, b in zip(each.text.splitlines(), SMALL.splitlines())].count(
            False
        ) == 1
        assert SMALL.splitlines()[each.line - 1].strip() == each.before
        assert each.text.splitlines()[each.line - 1].strip() == each.after
        assert ast.get_docstring(ast.parse(each.text)) == ast.get_docstring(ast.parse(SMALL))
    after = {each.after for each in every_mutant(FILE, SMALL)}
    assert {"/ (1 - µ)", "* (1 + µ)", "LIMIT = 0.475  # µ is 0.5", "return sin(first)"} <= after
    assert not any("Return T" in each or "ValueError" in each for each in after)


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


def test_every_change_of_the_filter_parses_and_differs() -> None:
    files = mutants.modules(mutants.ROOT)
    assert {"kinematic.py", "update.py", "drive_tracking.py"} <= {file.name for file in files}
    for file in files:
        source = (mutants.ROOT / file).read_text(encoding="utf-8")
        tree = ast.dump(ast.parse(source))
        for position in positions(source)[::20]:  # some of them: parsing takes its time
            each = mutant(file, source, position, position.after[-1])
            assert ast.dump(ast.parse(each.text)) != tree, (file, each.line, each.after)


def test_the_same_seed_gives_the_same_mutants() -> None:
    files = mutants.modules(mutants.ROOT)
    assert files == sorted(set(files))
    one, same, other = (mutants.drawn(mutants.ROOT, files, 20, seed) for seed in (1, 1, 2))
    assert one == same
    assert one != other
    assert len({(each.file, each.text) for each in one}) == 20
    # as many as there are, if more are asked for: every place once
    every = mutants.drawn(mutants.ROOT, files[:1], 10**6, 1)
    assert len(every) == len(positions((mutants.ROOT / files[0]).read_text(encoding="utf-8")))


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
def test_in_every_package_its_own_tests_run_first(project: Path) -> None:
    """Of a module in `estimators` those in tests/estimators; the tests of other packages come
    last.
    """
    (project / "tests/cli").mkdir()
    (project / "tests/cli/test_first.py").write_text(
        "from distal.estimators.kinematic import gain\n\n\ndef test_gain_too():\n    assert "
        "gain(1.0, 3.0) == 0.25\n"
    )
    (outcome,) = mutants.run(
        [made(project, "return p / (p + r)", "return p / (p - r)")], 1, project, "all"
    )
    assert outcome.by == "tests/estimators/test_gain.py::test_gain"


def test_all_packages_are_asked_but_drawings_and_the_papers() -> None:
    files = {file.as_posix() for file in mutants.modules(mutants.ROOT, "all")}
    assert {
        "src/distal/study/answer.py",
        "src/distal/cli/fit_command.py",
        "src/distal/units.py",
    } <= files
    assert not any("drawing/" in file or "/paper/" in file for file in files)


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
    assert '"share": 0.6666' in mutants.saved(tried, outcomes, 5)
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


def test_what_failed_first() -> None:
    said = (
        "....F\nFAILED tests/a/test_b.py::test_c[5 mm-rad - x] - AssertionError: a - b\n1 "
        "failed in 0.1s\n"
    )
    assert copies.first_failure(1, said).startswith("tests/a/test_b.py::test_c[5 mm-rad")
    assert copies.first_failure(1, "ERROR tests/a.py - NameError: x\n") == "tests/a.py"
    assert copies.first_failure(-11, "...\n") == "pytest ended with -11: ..."
    assert copies.first_failure(-9, "") == "pytest ended with -9: no output"

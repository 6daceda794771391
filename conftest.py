"""Fixtures of all tests: a kernel cache that runs of them share, shipped rigs, and the logs that
another simulator made.
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import hypothesis
import pytest
from threadpoolctl import threadpool_limits
from tools.slow_tests import function_of, keep, listed

from distal import Rig, load_rig

# processes of pytest share the cores: more threads of one would wait for those of the other
for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
threadpool_limits(1, "blas")

hypothesis.settings.register_profile("distal", deadline=None, derandomize=True, max_examples=60)
hypothesis.settings.load_profile("distal")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what golden files are written by."""
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden files anew, to look at in a diff",
    )


os.environ["DISTAL_TRACEBACK"] = (
    "1"  # a fault of distal in a command is an error of the test, not a line
)


KERNELS = Path(__file__).parent / "out" / "test-kernels"
"""Where the kernels of tests are kept from one run to the next; `make clean` removes them."""


LONGEST = ("tests/test_tutorial.py", "tests/fitting", "tests/cli", "tests/from_logs")
"""Tests that take longest."""

CASES = 2
"""So many cases of a slow test run in `make test`; `make test-all` runs the others too."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that were measured to be slow, and those of `make test-all` alone: further
    cases of these, and the benchmarks' own tools.
    """
    slow = listed()
    # the longest first, so that no process waits for it in the end
    items.sort(key=lambda item: not item.nodeid.startswith(LONGEST))
    cases: Counter[str] = Counter()
    for item in items:
        function = function_of(item.nodeid)
        cases[function] += 1
        if function in slow:
            item.add_marker(pytest.mark.slow)
        is_further = function in slow and cases[function] > CASES
        if is_further or function.startswith("benchmarks/"):
            item.add_marker(pytest.mark.more)


BUDGET = 10.0
"""Seconds of one test file; those beyond are listed at the end of a run, slowest first."""


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print what test files took."""
    cases: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport) and not report.skipped:
                cases[report.nodeid] += report.duration
    seconds: Counter[str] = Counter()
    dearest: dict[str, float] = {}
    for nodeid, time in cases.items():
        function = function_of(nodeid)
        seconds[nodeid.partition("::")[0]] += time
        dearest[function] = round(max(time, dearest.get(function, 0.0)), 2)
    keep(dearest)
    slowest = [(path, time) for path, time in seconds.most_common() if time > BUDGET]
    if slowest:
        terminalreporter.section(f"files beyond their {BUDGET:g} s")
        for path, time in slowest:
            terminalreporter.line(f"{time:7.1f} s  {path}")


@pytest.fixture(autouse=True, scope="session")
def _own_cache() -> None:
    # workers share the folder, and processes inherit it: each kernel is built once
    os.environ["DISTAL_CACHE"] = str(KERNELS)


@pytest.fixture
def as_users_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile as for users, also where `make test-fast` compiles quickly."""
    monkeypatch.delenv("DISTAL_COMPILE", raising=False)


@pytest.fixture(scope="session")
def paper_rig() -> Rig:
    """Return the paper's rig as it was printed."""
    return load_rig("paper-2008-printed")


@pytest.fixture(scope="session")
def pulley_rig() -> Rig:
    """Return the shipped rig of two pulleys."""
    return load_rig("pulley-antagonist")


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of the logs that another simulator made; without it the test is skipped."""
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        pytest.skip(
            "DISTAL_DATA is not set: the logs of another simulator are not part of the project"
        )
    return Path(folder)

"""Which tests are slow, by the last runs of all.

    python -m tools.slow_tests    # writes tests/slow.txt, which `make test-fast` leaves out

A run of tests keeps the seconds that each took in out/test-seconds.json.
"""

from __future__ import annotations

import json
from pathlib import Path

ROOT = Path(__file__).parents[1]
SECONDS = ROOT / "out" / "test-seconds.json"
LIST = ROOT / "tests" / "slow.txt"

FAST = 0.12
"""A test of which a case takes longer than this is slow [s]; 3,000 others take half a minute."""

ALWAYS = "tests/estimators/adaptive/test_twin.py"
"""What compares the filter with its equations runs at every save."""


def function_of(nodeid: str) -> str:
    """Return the test function of a test, without its case."""
    return nodeid.partition("[")[0]


def listed() -> frozenset[str]:
    """Return the functions that are slow."""
    text = LIST.read_text(encoding="utf-8") if LIST.exists() else ""
    return frozenset(text.splitlines())


def keep(seconds: dict[str, float]) -> None:
    """Keep what tests took, by function; those that did not run stay as they were."""
    kept = json.loads(SECONDS.read_text(encoding="utf-8")) if SECONDS.exists() else {}
    SECONDS.parent.mkdir(exist_ok=True)
    SECONDS.write_text(json.dumps({**kept, **seconds}, indent=0), encoding="utf-8")


def main() -> None:
    """Write the list."""
    kept: dict[str, float] = json.loads(SECONDS.read_text(encoding="utf-8"))
    dear = (function for function, seconds in kept.items() if seconds > FAST)
    slow = sorted(function for function in dear if not function.startswith((ALWAYS, "benchmarks/")))
    LIST.write_text("\n".join(slow) + "\n", encoding="utf-8")
    print(f"{len(slow)} of {len(kept)} test functions are slow")


if __name__ == "__main__":
    main()

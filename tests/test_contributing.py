"""The worked example of CONTRIBUTING.md is what it says: it runs, finds its torque, and is
short.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from tools.files import sentences

from distal import estimate, load_rig, simulate
from tests.helpers import turned_capstan

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "CONTRIBUTING.md"


def example() -> str:
    """Return the code of the section on a new kind of state."""
    section = PAGE.read_text(encoding="utf-8").split("## A new kind of state")[1]
    found = re.search(r"```python\n(.*?)```", section, re.DOTALL)
    assert found is not None
    return found[1]


def test_a_new_kind_of_state_finds_what_it_stands_for() -> None:
    code = example()
    assert len(code.splitlines()) <= 40
    made: dict[str, object] = {"__name__": "example"}
    exec(compile(code, str(PAGE), "exec", dont_inherit=True), made)
    rig = load_rig("capstan-joint")
    torque = {"jaw": {"torque": 0.03}}
    log = simulate(rig, turned_capstan(6.0, joints=torque), 1)
    found = estimate(log, rig, made["estimator_of"](rig))  # type: ignore[operator]
    torque = found.state("harness_torque")
    std = np.sqrt(found.variances[-1, found.state_names.index("harness_torque")])
    assert abs(torque[-1] - 0.03) < 3 * std
    assert std < 0.01  # half of the prior is learned
    usual = estimate(log, rig)
    assert "harness_torque" not in usual.state_names
    assert found.rms_error() < 0.5 * usual.rms_error()


def test_each_benchmark_is_run_by_make_or_used_by_another() -> None:
    """What nobody runs is not kept; mutants and stored estimates are commands of
    CONTRIBUTING.md.
    """
    commands = (ROOT / "Makefile").read_text("utf-8") + (ROOT / "CONTRIBUTING.md").read_text(
        "utf-8"
    )
    sources = [
        path
        for folder in ("benchmarks", "tests", "tools")
        for path in (ROOT / folder).rglob("*.py")
    ]
    code = {path: path.read_text("utf-8") for path in sources}
    for path in sorted((ROOT / "benchmarks").glob("*.py")):
        imported = re.compile(rf"benchmarks(\.{path.stem}| import .*\b{path.stem})\b")
        used = any(imported.search(text) for other, text in code.items() if other != path)
        assert used or f"benchmarks.{path.stem}" in commands or path.stem == "__init__", path.name


def test_each_module_says_in_a_sentence_what_it_has() -> None:
    """The listing by which a change finds its file: no module without a sentence, none that two
    share.
    """
    lines = list(sentences())
    said = [line[46:].strip() for line in lines]
    assert len(lines) > 120
    assert all(len(sentence) > 20 for sentence in said)
    assert len(set(said)) == len(said)
    assert [line.split()[0] for line in sentences("as one CasADi function of a sample")] == [
        "regression/features.py"
    ]

"""Small studies for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from distal.study import Plan, plan_of

STILL = """
rig = "paper-2008-observed"
name = "nothing moves"
duration = "0.1 s"

[drives.left]
weight = "6 N"

[drives.right]
weight = "6 N"
"""

RAW: dict[str, Any] = {
    "rig": "paper-2008-observed",
    "scenarios": ["series-2"],
    "duration": "0.05 s",
    "designs": 6,
    "seeds": 2,
    "requirement": {"joint": "link", "within": "1 deg"},
    "vary": {"tendons.*.stiffness": {"from": "700 N/m", "to": "900 N/m"}},
}


def small(**changes: Any) -> Plan:
    """Return a study of a few short runs."""
    return plan_of({**RAW, **changes})


def still(folder: Path, **changes: Any) -> Plan:
    """Return a study in which nothing moves."""
    (folder / "still.toml").write_text(STILL, encoding="utf-8")
    raw = {**RAW, "scenarios": ["still.toml"], "vary": {}, "estimator": "inextensible", **changes}
    return plan_of({key: value for key, value in raw.items() if key != "duration"}, "study", folder)

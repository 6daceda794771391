"""What may be wrong with a rig is tried in both directions: an arm that is too long, and one that is too short."""

from __future__ import annotations

import numpy as np

from distal import load_scenario, scenario_rig, simulate
from distal.diagnosis.rerun import Rerun
from distal.diagnosis.what_if import ARM, STIFF, _suspects
from distal.run.offline import runner_for


def test_each_number_is_tried_larger_and_smaller_by_as_much() -> None:
    scenario = load_scenario("series-2", ['duration="2 s"'])
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, 1)
    rerun = Rerun(log, runner_for(log, rig, "adaptive", compiled=False))  # type: ignore[arg-type]
    suspects = dict(_suspects(rerun))
    tried = [name for name in suspects if "radius" in name or "pretension" in name or name == "all moment arms"]
    assert len(tried) >= 3
    for name in tried:
        smaller, larger = suspects[name]
        assert set(smaller.numbers.values()) <= {1 - ARM}
        assert set(larger.numbers.values()) <= {1 + ARM}
        # of a state it is a shift, by as much to either side
        assert smaller.shifts == {state: -shift for state, shift in larger.shifts.items()}
        assert all(shift > 0.0 for shift in larger.shifts.values())
        assert smaller.numbers or smaller.shifts
    (springs,) = (changes for name, changes in suspects.items() if "stiffness" in name)
    factors = [factor for change in springs for factor in change.numbers.values()]
    np.testing.assert_allclose(sorted(set(factors)), sorted({1 / STIFF, STIFF}) if factors else [])
    signs = [changes for name, changes in suspects.items() if name.startswith("sign of")]
    assert all([set(change.channels.values()) for change in changes] == [{-1.0}] for changes in signs)

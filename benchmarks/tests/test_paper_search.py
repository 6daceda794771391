"""The search for the rig that the paper saw: what counts, what is chosen, what excludes each
other.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.paper_search import (
    UNKNOWNS,
    Search,
    margins_of,
    plant_of,
)
from distal.reports.paper_2008 import (
    PLANTS,
    SERIES_1,
    Measure,
    Statement,
    hung_weights,
    observed_values,
    run_series,
    statements,
)

COUNT = 12


def found(*rows: tuple[float, ...]) -> Search:
    """Return a search whose plants have these margins of the first statements; the others do not
    hold.
    """
    margins = np.full((len(rows), COUNT), -1.0)
    for row, values in zip(margins, rows):
        row[: len(values)] = values
    middle = np.array([(each.low + each.high) / 2 for each in UNKNOWNS])
    return Search(np.tile(middle, (len(rows), 1)), np.arange(len(rows)) % 2, margins)


def test_a_margin_is_a_share_of_the_bound() -> None:
    assert Measure("", 2.0, None).margin(2.5) == pytest.approx(0.25)
    assert Measure("", None, 0.5).margin(0.6) == pytest.approx(-0.2)
    assert Measure("", None, 0.5).margin(np.nan) == -np.inf
    both = Statement("C0", "", "", "", (Measure("", 1.0, None), Measure("", None, 4.0)))
    assert both.margin((3.0, 3.0)) == pytest.approx(0.25)  # the smaller of 2 and 1/4


def test_the_best_holds_most_and_then_by_the_largest_margin() -> None:
    """A miss, however small, does not hold; among equals the one farthest from every threshold
    wins.
    """
    every = found((0.5, 0.1, -0.001), (0.3, 0.2, -0.9), (9.0, -0.1, -0.1), (0.0, 0.0, 0.0))
    assert list(every.order()) == [3, 1, 0, 2]
    assert every.held[3, :3].all()


def test_a_statement_is_tested_on_the_plant_that_the_others_choose() -> None:
    """The first holds on the plant of the others too; the third is what chose its plant."""
    every = found((0.1, 0.1, -1.0, 0.1), (-1.0, -1.0, 0.5, 0.1))
    tested = every.tested()
    assert tested[0]
    assert not tested[2]


def test_pairs_that_exclude_each_other() -> None:
    every = found((0.1, -0.1, -0.1), (-0.1, 0.1, 0.1))
    assert every.excluding() == [(0, 1), (0, 2)]  # the fourth holds nowhere: it excludes nothing


def test_the_thresholds_are_those_that_were_written_down() -> None:
    """They are not moved: a plant is searched that keeps them."""
    bounds = {each.key: [(m.least, m.most) for m in each.measures] for each in statements()}
    assert bounds == {
        "C1": [(1.2, None)],
        "C2": [(None, 0.9)],
        "C3": [(None, 0.75), (0.6, None), (0.9, None)],
        "C4": [(5.0, None)],
        "C5": [(None, 0.333)],
        "C6": [(1.2, None)],
        "C7": [(None, 0.75)],
        "C8": [(5.0, None), (None, 8.0), (1.5, None)],
        "C9": [(None, 0.6)],
        "C10": [(0.8, None)],
        "C11": [(None, 0.9)],
        "C12": [(None, 0.75)],
    }


def test_the_potentiometers_angle_is_read_over_the_radius() -> None:
    """θ = ±x/r from the first sample on: 9.53 mm is the radius of Table 1."""
    run = run_series(SERIES_1[1], PLANTS[0], (0,))[0]
    left = run.estimates["inextensible"].means[:, 1]
    moved = run.log.channels["x1"] - run.log.channels["x1"][0]
    np.testing.assert_allclose(left - left[0], moved / 9.53e-3, atol=1e-9)


def test_hung_weights_replace_the_cells() -> None:
    scenario = PLANTS[0].scenario("series-2")
    run = run_series("series-2", PLANTS[0], (0,), statements_only=True)[0]
    log = hung_weights(run.log, scenario)
    assert set(np.unique(log.channels["u1"])) == {2.0, 6.0}
    assert set(np.unique(log.channels["u2"])) == {2.0}
    assert not np.array_equal(run.log.channels["u1"], log.channels["u1"])


@pytest.mark.slow
def test_ten_statements_hold_on_the_shipped_plant() -> None:
    values = observed_values()
    drawn = [values[f"drives.0.friction.{name}"] for name in ("constant", "load")]
    drawn += [values[f"joints.0.friction.{name}"] for name in ("exponent", "reference", "preload")]
    margins = margins_of(plant_of(np.array([*drawn, 20.6], dtype=float), "x/r"))
    assert [each.key for each, margin in zip(statements(), margins) if margin < 0.0] == [
        "C2",
        "C12",
    ]

"""Suggestions: what could be done of a rig, and how its two ranks agree."""

from __future__ import annotations

import numpy as np
import pytest

from distal import load_rig
from distal.errors import StudyError
from distal.study.suggest import Suggestion, differs, options_of, suggestions
from tests.study.plans import small


def test_options_are_numbers_sensors_and_a_calibration() -> None:
    found = {option.words: option for option in options_of(load_rig("paper-2008-observed"), 0.1)}
    known = found["friction coefficient of all joints known twice as well"].rig
    assert known.joints[0].friction is not None
    assert known.joints[0].friction.coefficient.std == 0.05
    tied = found["stiffness of all tendons in common known twice as well"].rig
    assert [t.stiffness.shared and t.stiffness.shared.std for t in tied.tendons] == [0.05, 0.05]
    cells = found["a tension sensor of 0.3 N on each tendon"].rig
    assert [sensor.of for sensor in cells.sensors_of("tension")] == ["left", "right"]
    assert [s.noise for s in found["force sensors twice as good"].rig.sensors_of("force")] == [
        0.15,
        0.15,
    ]
    assert found["the angle known for the first 2 s"].homing == 2.0
    assert next(iter(found)) == "as it is"


def test_added_sensors_are_as_noisy_as_the_study_says_where_there_is_none_to_copy() -> None:
    rig = load_rig("paper-2008-observed")
    cells = [f"sensors.{sensor.name}.noise" for sensor in rig.sensors_of("force")]
    found = [option.words for option in options_of(rig.with_values(dict.fromkeys(cells, 0.0)), 0.2)]
    assert "a tension sensor of 0.2 N on each tendon" in found


def test_an_option_differs_where_its_plants_show_it() -> None:
    """One in twenty options that change nothing seems to: the level of the test is 0.05."""
    rng = np.random.default_rng(0)
    base = Suggestion("", 1.0, rng.uniform(1.0, 2.0, size=24))
    seems = [
        differs(base, Suggestion("", 1.0, base.squares + rng.normal(size=24))) for _ in range(400)
    ]
    assert np.mean(seems) == pytest.approx(0.05, abs=0.03)
    assert differs(base, Suggestion("", 1.0, 0.5 * base.squares))
    failed = np.where(np.arange(24) < 4, np.nan, 0.5 * base.squares)
    assert differs(base, Suggestion("", 1.0, failed))
    assert not differs(base, Suggestion("", 1.0, base.squares))


def test_suggestions_need_a_covariance() -> None:
    with pytest.raises(StudyError, match="'inextensible' came as estimator"):
        suggestions(small(estimator="inextensible"))


@pytest.mark.slow
def test_the_ranks_by_covariance_and_by_simulation_agree() -> None:
    base, found, tau = suggestions(small(duration="6 s"))
    assert len(found) >= 6
    assert tau >= 0.7
    assert [one.band for one in found] == sorted(one.band for one in found)
    assert found[0].error < base.error

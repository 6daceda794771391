"""Suggestions: what could be done of a rig, and what it brings."""

from __future__ import annotations

import pytest

from distal import load_rig
from distal.errors import StudyError
from distal.study.suggest import options_of, suggestions
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


def test_suggestions_need_a_covariance() -> None:
    with pytest.raises(StudyError, match="'inextensible' came as estimator"):
        suggestions(small(estimator="inextensible"))


@pytest.mark.more
@pytest.mark.slow
def test_options_come_by_their_band_and_a_calibration_helps() -> None:
    base, found = suggestions(small(duration="4 s"))
    assert len(found) >= 6
    assert [one.band for one in found] == sorted(one.band for one in found)
    assert found[0].words == "the angle known for the first 2 s"
    assert found[0].error < base.error

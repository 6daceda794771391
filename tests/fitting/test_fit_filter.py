"""The rows that the filter of a fit takes of a log."""

from __future__ import annotations

import numpy as np

from distal import Log, load_rig
from distal.fitting.likelihood import FitFilter
from distal.homing import with_references


def test_a_fits_rows_are_a_logs_samples_with_their_intervals() -> None:
    """The first row has no interval before it; intervals add up to the stamps, and each sample's
    own row has its values.
    """
    rig = load_rig("capstan-joint")
    time = 5.0 + np.arange(40) / 200.0
    angle = 0.3 * np.sin(9.0 * time)
    log = Log(time, {"motor_angle": angle, "motor_torque": np.cos(time)}, {"theta": 0.6 * angle})
    described, references = with_references(rig, log)
    fit = FitFilter(described, references, (), compiled=False)
    data = fit.data_of(log)
    assert data.rows[0, 0] == 0.0
    assert (data.rows[1:, 0] > 0.0).all()
    np.testing.assert_allclose(np.cumsum(data.rows[:, 0])[data.last], time - time[0], atol=1e-12)
    width = len(fit.channels)
    at = fit.channels.index("motor_torque")
    np.testing.assert_allclose(data.rows[data.last, 1 + at], np.cos(time))
    assert (data.rows[data.last, 1 + width + at] == 1.0).all()
    np.testing.assert_allclose(data.rows[data.last, width], 0.6 * angle)
    assert len(data.rows) == 40

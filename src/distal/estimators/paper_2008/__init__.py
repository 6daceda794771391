"""The 2008 paper's filter, `ekf-2008`, and the same filter with the sensors' noise, `ekf`."""

from distal.estimators.paper_2008.full_state import (
    FullStateFilter,
    Noise,
    paper_noise,
    rig_noise,
)

__all__ = ["FullStateFilter", "Noise", "paper_noise", "rig_noise"]

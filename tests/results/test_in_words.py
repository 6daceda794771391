"""What `print` and notebooks show of results and descriptions: short, and without arrays."""

from __future__ import annotations

import pytest

from distal import Estimate, Log, Rig, fit


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_everything_public_says_what_it_is_in_a_line(result: Estimate, log: Log, rig: Rig) -> None:
    assert repr(rig) == str(rig)
    assert str(rig).endswith(": 1 joint, 2 drives, 2 tendons, 5 sensors")
    truth = ", ".join(log.truth)
    assert repr(log).endswith(
        f"800 samples, 0 to 7.99 s, 100 Hz; x1, u1, x2, u2, encoder; truth: {truth}"
    )
    assert "<table" in result._repr_html_()
    assert "800 samples of &#x27;Nylon-tendon disk" in result._repr_html_()
    fitted = repr(fit([log], rig, free="joints.link.friction.coefficient", noise=False))
    assert "to 1 log of 8 s in all, converged: 1 " in fitted
    assert len(fitted) < 300

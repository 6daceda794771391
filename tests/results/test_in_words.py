"""What `print` and notebooks show of results and descriptions: short, and without arrays."""

from __future__ import annotations

import pytest

from distal import estimate, fit, load_rig, simulate


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_everything_public_says_what_it_is_in_a_line() -> None:
    rig = load_rig("template")
    log = simulate(rig, "template", seed=1).select(slice(0, 400))
    assert repr(rig) == str(rig) == "Rig 'My joint': 1 joint, 2 drives, 2 tendons, 4 sensors"
    assert repr(log).endswith(
        "400 samples, 0 to 3.99 s, 100 Hz; x1, x2, u1, u2; truth: " + ", ".join(log.truth)
    )
    found = estimate(log, rig, "elastic", compiled=False)
    assert "<table" in found._repr_html_()
    assert "400 samples of &#x27;My joint&#x27;" in found._repr_html_()
    result = fit([log], rig, free="joints.link.friction.coefficient", noise=False)
    assert repr(result).startswith("Fit of 'My joint' to 1 log of 4 s in all, converged: 1 ")
    assert len(repr(result)) < 300

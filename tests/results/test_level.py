"""One level of confidence, from the option to what is printed and drawn."""

import re
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import distal
from distal.cli.app import app
from distal.confidence import COVERED, half_width, in_percent


def test_a_level_is_that_of_a_normal_distribution() -> None:
    assert half_width(COVERED) == pytest.approx(1.959964, abs=1e-6)
    assert half_width(0.6827) == pytest.approx(1.0, abs=1e-3)
    assert in_percent(0.995) == "99.5 %"
    for level in (0.0, 1.0, float("nan")):
        with pytest.raises(distal.DistalError, match=r"between 0 and 1; .* came"):
            half_width(level)


def test_estimate_prints_the_band_of_a_level(tmp_path) -> None:  # type: ignore[no-untyped-def]
    rig = distal.load_rig("template")
    log = distal.simulate(rig, "template", seed=3)
    result = distal.estimate(log, rig)
    narrow = replace(result, level=0.5)
    ratio = half_width(0.5) / half_width(COVERED)
    assert narrow.half_width() == pytest.approx(ratio * result.half_width())
    assert narrow.inside_band() < result.inside_band()
    assert "50 % band" in narrow.in_words()
    path = tmp_path / "log.csv"
    distal.write_log(log, rig, path)
    printed = {}
    for level in ("0.95", "0.5"):
        done = CliRunner().invoke(
            app, ["estimate", str(path), "--rig", "template", "--level", level]
        )
        assert done.exit_code == 0, done.output
        found = re.search(r"(\d+) % band ±([\d.]+)°", done.output)
        assert found is not None
        printed[found[1]] = float(found[2])
    assert printed["50"] == pytest.approx(ratio * printed["95"], abs=0.01)
    assert np.isfinite(printed["50"])

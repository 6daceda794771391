"""`distal view`: one file that fetches nothing, with what it should show; zoom and hover in a
browser.
"""

from __future__ import annotations

import builtins
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distal import Estimate, Log, Rig, estimate, load_rig, load_scenario, scenario_rig, simulate
from distal.errors import OutputError
from distal.reports import view_page

BROWSER = (
    shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("template"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    made = simulate(rig, load_scenario("template"), 4).select(slice(0, 600))
    return replace(made, time=made.time + 100.0, source="a <b>log & more.csv")


@pytest.fixture(scope="module")
def result(log: Log, rig: Rig) -> Estimate:
    return estimate(log, rig)


@pytest.fixture(scope="module")
def page(result: Estimate, log: Log, rig: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return view_page(
        result, log, rig, tmp_path_factory.mktemp("view") / "view.html", ["what <was> found"]
    )


def test_one_file_that_fetches_nothing(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    body = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!#)", body)
    assert not re.search(r"<script[^>]+src", text)
    assert "a &lt;b&gt;log &amp; more.csv" in body
    assert "what &lt;was&gt; found" in body
    assert "RMS error" in body
    assert "aria-label='Drawing of the rig" in body
    for name in (
        "joint angle",
        "error",
        "innovation",
        "measured",
        "health",
        "truth",
        "adaptive",
        "u1 [N]",
    ):
        assert name in text


def test_without_a_truth_the_band_is_drawn(
    result: Estimate, log: Log, rig: Rig, tmp_path: Path
) -> None:
    blind = replace(result, truths=None)
    text = view_page(blind, replace(log, truth={}), rig, tmp_path / "blind.html").read_text(
        encoding="utf-8"
    )
    assert "95 % band \\u00b1 [" in text
    assert "error [" not in text


def test_joints_stand_below_one_another(tmp_path: Path) -> None:
    """One column: every curve has a time axis below it, the toolbar lies above and the legend below
    all of them.
    """
    rig = load_rig("finger-2n")
    log = simulate(rig, load_scenario("finger", ['duration="1 s"']), 1)
    text = view_page(estimate(log, rig), log, rig, tmp_path / "two.html").read_text(
        encoding="utf-8"
    )
    layout = json.JSONDecoder().raw_decode(text, text.index('{"template"'))[0]
    shown = [
        key
        for key, axis in layout.items()
        if key.startswith("xaxis") and axis.get("showticklabels")
    ]
    assert shown == ["xaxis2", "xaxis4", "xaxis7"]
    assert {tuple(axis["domain"]) for key, axis in layout.items() if key.startswith("xaxis")} == {
        (0.0, 1.0)
    }
    titles = [layout[f"yaxis{k}"]["title"]["text"] for k in ("", 2, 3, 4)]
    assert titles == ["mcp [°]", "error [°]", "pip [°]", "error [°]"]
    assert layout["legend"]["y"] < 0.0
    assert layout["legend"]["yanchor"] == "top"


def test_without_plotly(
    result: Estimate, log: Log, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def absent(name: str, *rest: object, **more: object) -> object:
        if name.split(".")[0] == "plotly":
            raise ImportError(name)
        return real(name, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(OutputError, match=r"pip install '\.\[view\]'"):
        view_page(result, log, rig, tmp_path / "view.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium here")
def test_zoom_and_hover_in_a_browser(page: Path, result: Estimate, tmp_path: Path) -> None:
    """The page draws, all axes zoom together, and pointing at a time reads the curves there."""
    script = """<script>window.addEventListener('load', async () => {
      const plot = document.querySelector('.js-plotly-plot');
      await Plotly.relayout(plot, {'xaxis.range': [1, 2]});
      const ranges = Object.keys(plot._fullLayout).filter(k => /^xaxis\\d*$/.test(k)).map(k => plot._fullLayout[k].range);
      Plotly.Fx.hover(plot, [{curveNumber: 3, pointNumber: 150}]);
      const read = document.querySelector('.hoverlayer').textContent;
      const told = {ranges: ranges, read: read, drawn: document.querySelectorAll('.scatterlayer .trace').length};
      document.body.setAttribute('data-told', JSON.stringify(told));
    });</script>"""
    copy = tmp_path / "copy.html"
    copy.write_text(
        page.read_text(encoding="utf-8").replace("</body>", f"{script}</body>"), encoding="utf-8"
    )
    words = [
        str(BROWSER),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-background-networking",
    ]
    words += [
        "--host-resolver-rules=MAP * 0.0.0.0",
        "--virtual-time-budget=10000",
        "--window-size=1200,1000",
        "--dump-dom",
    ]
    done = subprocess.run(
        [*words, copy.as_uri()], capture_output=True, text=True, check=True, timeout=120
    )
    identified = re.search(r'data-told="(.*?)"', done.stdout)
    assert identified is not None
    held = json.loads(identified[1].replace("&quot;", '"'))
    assert len(held["ranges"]) == 5
    assert all(np.allclose(limits, [1, 2]) for limits in held["ranges"])
    assert held["drawn"] >= 9
    assert re.search(r"[-−]?\d", held["read"])
    assert "adaptive" in held["read"]

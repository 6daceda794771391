"""Public logs: what is fetched is what is known, or nothing is kept."""

from __future__ import annotations

from pathlib import Path

import pytest
from examples.da_vinci import logs as datasets
from examples.da_vinci.logs import da_vinci_grasper

from distal.errors import LogError

RAW = """%This file holds comments
%Back-end Time [ms], Back-end CUI Encoder [counts], ...
0.000,0.00,1224.00,0.091,859.00,-322.00,0.10,-0.05,1901.00,0.00
0.001,0.00,1218.00,-0.007,859.00,-316.00,0.10,0.00,1901.00,0.00
0.002,0.00,1208.00,-0.003,859.00,-322.00,0.10,-0.00,1898.00,0.00
0.003,0.00,1184.00,-0.003,859.00,-316.00,0.10,-0.00,1894.00,0.00
0.004,0.00,1174.00,-0.012,859.00,-318.00,0.10,-0.00,1888.00,0.00
0.005,0.00,1148.00,0.003,859.00,-314.00,0.10,-0.00,1881.00,0.00
"""


def test_counts_become_units() -> None:
    counts = datasets.counts_of(RAW)
    assert counts.tolist() == [[0, 0, 1224, 91, 859, -322], [5, 0, 1148, 3, 859, -314]]
    lines = datasets.csv_of(counts).splitlines()
    assert lines[0] == "t_s,theta_prox_deg,tau_prox_Nm,i_motor_A,theta_true_deg,tau_true_Nm"
    assert lines[1] == "0,0,0.04872866,0.091,77.31,-0.01281914"


def test_what_is_not_known_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="is not the one that is known"):
        datasets.check_fingerprint("00", datasets.counts_of(RAW))
    with pytest.raises(LogError, match="not a table of numbers"):
        datasets.counts_of("<html>moved</html>")
    monkeypatch.setattr(datasets, "_fetched", lambda run: RAW)
    with pytest.raises(LogError, match="nothing was kept"):
        da_vinci_grasper(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_fetched_run_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Fetched once, then read from the folder, the licence beside it."""
    counts, asked = datasets.counts_of(RAW), []
    monkeypatch.setattr(datasets, "FINGERPRINTS", {"00": datasets.fingerprint(counts)})

    def fetched(run: str) -> str:
        asked.append(run)
        return RAW

    monkeypatch.setattr(datasets, "_fetched", fetched)
    for _ in range(2):
        (path,) = da_vinci_grasper(tmp_path)
    assert asked == ["00"]
    assert path.name == "run_00.csv"
    assert "Open" in (tmp_path / "LICENCE.txt").read_text()

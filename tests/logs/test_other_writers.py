"""Tables as other programs write them are read right, or named with a remedy that is followed here."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, load_rig, read_log
from distal.errors import DistalWarning, LogError
from distal.from_logs import rig_from_logs
from distal.logs import says_nothing
from distal.rig import build_rig

N = 400
TIME = 0.01 * np.arange(N)
RNG = np.random.default_rng(5)
POSITION = 2e-3 + 1e-3 * np.sin(3.0 * TIME) + 1e-5 * RNG.normal(size=N)
FORCE = 2.0 + 0.5 * np.cos(3.0 * TIME) + 0.1 * RNG.normal(size=N)
NAMES = ("t", "x1", "x2", "u1", "u2")


def cells(stamps: list[str] | None = None) -> list[list[str]]:
    """Return the rows of a good log, with other stamps where they are given."""
    table = np.column_stack([POSITION, 4e-3 - POSITION, FORCE, 4.0 - FORCE])
    texts = stamps or [f"{t:.2f}" for t in TIME]
    return [[text, *(f"{value:.7f}" for value in row)] for text, row in zip(texts, table)]


def written(
    path: Path, rows: list[list[str]], separator: str = ",", header: list[str] | None = None
) -> Path:
    lines = header if header is not None else [separator.join(NAMES)]
    path.write_text("\n".join([*lines, *(separator.join(row) for row in rows)]) + "\n")
    return path


def set_in(rig: Rig, remedy: str) -> Rig:
    """Return a rig with what a message says to set: --set 'path=value'."""
    match = re.search(r"--set '([\w.]+)=\"?([^\"']+)\"?'", remedy)
    assert match is not None, remedy
    return rig.with_values({match[1]: match[2]})


def check(log: Log, stamps: np.ndarray = TIME) -> None:
    np.testing.assert_allclose(log.time - log.time[0], stamps - stamps[0], atol=1e-6)
    np.testing.assert_allclose(log.channels["x1"], POSITION, atol=1e-6)
    np.testing.assert_allclose(log.channels["u2"], 4.0 - FORCE, atol=1e-6)


def clock(second: float, form: str) -> str:
    """Return a time of day, counted from 23:59:58."""
    total = (86398.0 + second) % 86400.0
    hours, minutes = int(total // 3600), int(total // 60 % 60)
    seconds = f"{total % 60:06.3f}"
    if form == "24 h":
        return f"{hours:02d}:{minutes:02d}:{seconds}"
    half = "PM" if hours >= 12 else "AM"
    twelve = f"{hours % 12 or 12}:{minutes:02d}:{seconds} {half}"
    return twelve if form == "12 h" else f"{'25' if half == 'PM' else '26'}/10/2026 {twelve}"


@pytest.mark.parametrize("form", ["24 h", "12 h", "with a date"])
def test_times_of_day_go_on_over_midnight(form: str, tmp_path: Path, pulley_rig: Rig) -> None:
    path = written(tmp_path / "log.csv", cells([clock(t, form) for t in TIME]))
    check(read_log(path, pulley_rig))
    rows = cells([clock(t, form) for t in TIME])
    rows[7][0] = "half past nine"
    with pytest.raises(LogError, match=r"row 9, column 't': 'half past nine' is no time of day"):
        read_log(written(path, rows), pulley_rig)


def test_units_below_the_header_a_header_again_and_decimal_commas(
    tmp_path: Path, pulley_rig: Rig
) -> None:
    rows = cells()
    for row in rows:
        row[1] = f"{1e3 * float(row[1]):.5f}"
    german = [[cell.replace(".", ",") for cell in row] for row in rows]
    for units in ("s;mm;m;N;N", "[s];[mm];[m];[N];[N]", "(s);(mm);-;(N);"):
        path = written(tmp_path / "log.csv", german, ";", [";".join(NAMES), units])
        check(read_log(path, pulley_rig))
    again = cells()
    again.insert(150, list(NAMES))
    again.insert(200, list(NAMES))
    with pytest.warns(DistalWarning, match="row 152 repeats the header, 2 in all"):
        check(read_log(written(tmp_path / "log.csv", again), pulley_rig))


def test_names_behind_a_mark_and_blanks_between_cells(tmp_path: Path, pulley_rig: Rig) -> None:
    header = ["# logger 2.1", "#", "#" + " ".join(NAMES)]
    check(read_log(written(tmp_path / "log.csv", cells(), " ", header), pulley_rig))
    header = ["# made by hand, 2026", ",".join(NAMES)]
    check(read_log(written(tmp_path / "log.csv", cells(), ",", header), pulley_rig))


def test_rounded_stamps_are_spread_as_the_message_says(tmp_path: Path, pulley_rig: Rig) -> None:
    for digits in (0, 1):
        stamps = [
            f"{1732340000.0 + np.floor(t * 10**digits) / 10**digits:.{digits}f}" for t in TIME
        ]
        path = written(tmp_path / "log.csv", cells(stamps))
        with pytest.raises(LogError, match="rows share each stamp of 't': it was rounded") as no:
            read_log(path, pulley_rig)
        check(read_log(path, set_in(pulley_rig, str(no.value))))
    first_part = cells([f"{np.floor(t + 0.37):.0f}" for t in TIME])
    path = written(tmp_path / "log.csv", first_part)
    spread = pulley_rig.with_values({"log.time.repeated": "spread"})
    check(read_log(path, spread))


def test_a_log_without_a_time_has_a_rate(tmp_path: Path, pulley_rig: Rig) -> None:
    """None at all, or one of six digits; the message's own value is that of the sensors."""
    path = written(tmp_path / "log.csv", cells(["1.73234e+09"] * N))
    with pytest.raises(LogError, match="too few digits to be a time") as no:
        read_log(path, pulley_rig)
    check(read_log(path, set_in(pulley_rig, str(no.value))))
    without = [row[1:] for row in cells()]
    path = written(tmp_path / "log.csv", without, ",", [",".join(NAMES[1:])])
    with pytest.raises(LogError, match=r"'t' is missing, which is the time.*their rate") as no:
        read_log(path, pulley_rig)
    check(read_log(path, set_in(pulley_rig, str(no.value))))


def test_lists_in_cells_are_named(tmp_path: Path, pulley_rig: Rig) -> None:
    rows = [[row[0], f'"({row[1]}, {row[2]})"', *row[2:]] for row in cells()]
    path = written(tmp_path / "log.csv", rows)
    with pytest.raises(LogError, match=r"'x1' holds lists as text.*read the bag itself"):
        read_log(path, pulley_rig)


def test_a_force_without_a_sign_or_a_value_is_left_out_and_said(
    tmp_path: Path, pulley_rig: Rig
) -> None:
    """One that a sensor cuts at zero, or that never comes near it, stays."""
    signed = 0.5 * np.cos(3.0 * TIME) + 0.1 * RNG.normal(size=N)

    def read(force: np.ndarray) -> np.ndarray:
        rows = cells()
        for row, value in zip(rows, force):
            row[3] = f"{value:.5f}"
        return read_log(written(tmp_path / "log.csv", rows), pulley_rig).channels["u1"]

    for force, said in (
        (np.abs(signed), "u1 never changes its sign"),
        (np.zeros(N), r"u1 has one value \(0\) in the whole log while its drive moves"),
    ):
        with pytest.warns(DistalWarning, match=said):
            assert np.isnan(read(force)).all()
    for force in (signed, 3.0 + signed):
        np.testing.assert_allclose(read(force), force, atol=1e-5)
    assert says_nothing(np.maximum(signed, 0.0)) is None


def test_a_register_with_a_sign_is_decoded_from_the_first_row(tmp_path: Path) -> None:
    raw = load_rig("capstan-joint").model_dump()
    encoder, current, *others = (dict(sensor) for sensor in raw["sensors"])
    encoder |= {"unit": "count", "counts_per_turn": 4096, "resolution": 1.5e-3}
    rig = build_rig({**raw, "sensors": [encoder, current, *others]}, "counting")
    position, force = rig.sensors[0].log_column, rig.sensors[1].log_column
    counts = np.round(-80.0 + 200.0 * (1.0 - np.cos(2.0 * TIME)))
    flagged = np.where(counts < 0, 2.0**15 - counts, counts)
    path = tmp_path / "log.csv"
    rows = [f"{t:.2f},{c:.0f},{0.01 * f:.5f}" for t, c, f in zip(TIME, flagged, FORCE)]
    path.write_text("\n".join([f"{rig.log.time.column},{position},{force}", *rows]))
    with pytest.warns(DistalWarning, match="the first at 0 s"):
        log = read_log(path, rig)
    np.testing.assert_allclose(log.channels[rig.sensors[0].name], counts * 2 * np.pi / 4096)


def test_episodes_without_a_time_are_learned_with_a_rate(tmp_path: Path) -> None:
    """Also from times of day; the rig says where later logs have theirs."""
    joint = np.rad2deg(0.6 * np.sin(2.0 * TIME) + 0.2 * np.sin(5.0 * TIME))
    paths = []
    for k in range(3):
        angle = joint + 5.0 * np.sin((1.0 + k) * TIME)
        noise = np.random.default_rng(k).normal(0.0, 0.05, N)
        path = tmp_path / f"run_{k}.csv"
        rows = [f"{1.3 * a:.4f},{a + e:.4f}" for a, e in zip(angle, noise)]
        path.write_text("\n".join(["motor [deg],joint [deg]", *rows]))
        paths.append(path)
    with pytest.raises(LogError, match="say how many come in a second, as --rate 50"):
        rig_from_logs(paths)
    rig = rig_from_logs(paths, rate=100.0).rig
    assert rig.log.time.rate == 100.0
    np.testing.assert_allclose(read_log(paths[0], rig).time, TIME, atol=1e-9)
    assert rig.sensors[0].rate == pytest.approx(100.0)

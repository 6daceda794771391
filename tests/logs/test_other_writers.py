"""Tables as other programs write them are read right, or named with a remedy that is followed here."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal import Log, Rig, load_rig, read_log
from distal.errors import DistalWarning, LogError
from distal.from_logs import rig_from_logs
from distal.logs import says_nothing

N = 400
TIME = 0.01 * np.arange(N)
RNG = np.random.default_rng(5)
POSITION = 2e-3 + 1e-3 * np.sin(3.0 * TIME) + 1e-5 * RNG.normal(size=N)
FORCE = 2.0 + 0.5 * np.cos(3.0 * TIME) + 0.1 * RNG.normal(size=N)
NAMES = ("t", "x1", "x2", "u1", "u2")


DEFAULT = [f"{t:.2f}" for t in TIME]


@pytest.fixture
def read(tmp_path: Path, pulley_rig: Rig) -> Callable[..., Log]:
    """Write a good log with other stamps and columns as another program would, and read it, by a
    rig with what a message says to set: --set 'path=value'.
    """

    def call(
        stamps: Iterable[str] = DEFAULT,
        header: tuple[str, ...] = (",".join(NAMES),),
        separator: str = ",",
        remedy: object = "",
        **changed: Iterable[str],
    ) -> Log:
        rows = zip(stamps, *(COLUMNS | changed).values()) if stamps else zip(*COLUMNS.values())
        path = tmp_path / "log.csv"
        path.write_text("\n".join([*header, *map(separator.join, rows)]) + "\n")
        found = re.findall(r"--set '([\w.]+)=\"?([^\"']+)\"?'", str(remedy))
        assert bool(found) == bool(remedy)
        return read_log(path, pulley_rig.with_values(dict(found[:1])))

    return call


def check(log: Log, stamps: np.ndarray = TIME) -> None:
    np.testing.assert_allclose(log.time - log.time[0], stamps - stamps[0], atol=1e-6)
    np.testing.assert_allclose(log.channels["x1"], POSITION, atol=1e-6)
    np.testing.assert_allclose(log.channels["u2"], 4.0 - FORCE, atol=1e-6)


TABLE = (POSITION, 4e-3 - POSITION, FORCE, 4.0 - FORCE)
COLUMNS = {name: [f"{v:.7f}" for v in values] for name, values in zip(NAMES[1:], TABLE)}


@pytest.mark.parametrize("units", ["s;mm;m;N;N", "[s];[mm];[m];[N];[N]", "(s);(mm);-;(N);"])
def test_units_below_the_header_and_decimal_commas(read, units: str) -> None:
    dotted = COLUMNS | {"t": DEFAULT, "x1": [f"{1e3 * v:.5f}" for v in POSITION]}
    columns = {name: [cell.replace(".", ",") for cell in c] for name, c in dotted.items()}
    check(read(columns.pop("t"), (";".join(NAMES), units), ";", **columns))


def test_a_header_again(read) -> None:
    again = {name: [*c[:150], name, *c[150:200], name, *c[200:]] for name, c in COLUMNS.items()}
    stamps = [*DEFAULT[:150], "t", *DEFAULT[150:200], "t", *DEFAULT[200:]]
    with pytest.warns(DistalWarning, match="row 152 repeats the header, 2 in all"):
        check(read(stamps, **again))


def test_names_behind_a_mark_and_blanks_between_cells(read) -> None:
    check(read(header=("# logger 2.1", "#", "#" + " ".join(NAMES)), separator=" "))
    check(read(header=("# made by hand, 2026", ",".join(NAMES))))


@pytest.mark.parametrize("digits", [0, 1])
def test_rounded_stamps_are_spread_as_the_message_says(read, digits: int) -> None:
    """Also where the log begins within one."""
    floors = np.floor(TIME * 10**digits) / 10**digits
    stamps = [f"{1732340000.0 + t:.{digits}f}" for t in floors]
    with pytest.raises(LogError, match="rows share each stamp of 't': it was rounded") as no:
        read(stamps)
    check(read(stamps, remedy=no.value))
    check(read([f"{np.floor(t + 0.37):.0f}" for t in TIME], remedy=no.value))


@pytest.mark.parametrize(
    ("stamps", "names", "said"),
    [
        (["1.73234e+09"] * N, NAMES, "too few digits to be a time"),
        ([], NAMES[1:], r"'t' is missing, which is the time.*their rate"),
    ],
)
def test_a_log_without_a_time_has_a_rate(
    read, stamps: list[str], names: tuple[str, ...], said: str
) -> None:
    """None at all, or one of six digits; the message's own value is that of the sensors."""
    header = (",".join(names),)
    with pytest.raises(LogError, match=said) as no:
        read(stamps, header)
    check(read(stamps, header, remedy=no.value))


def test_lists_in_cells_are_named(read) -> None:
    with pytest.raises(LogError, match=r"'x1' holds lists as text.*read the bag itself"):
        read(x1=['"(0.001, 0.003)"'] * N)


def test_a_force_without_a_sign_or_a_value_is_left_out_and_said(read) -> None:
    """One that a sensor cuts at zero, or that never comes near it, stays."""
    signed = 0.5 * np.cos(3.0 * TIME) + 0.1 * RNG.normal(size=N)
    for force, said in (
        (np.abs(signed), "u1 never changes its sign"),
        (np.zeros(N), r"u1 has one value \(0\) in the whole log while its drive moves"),
    ):
        with pytest.warns(DistalWarning, match=said):
            assert np.isnan(read(u1=map(str, force)).channels["u1"]).all()
    for force in (signed, 3.0 + signed):
        np.testing.assert_array_equal(read(u1=map(str, force)).channels["u1"], force)
    assert says_nothing(np.maximum(signed, 0.0)) is None


def test_a_register_with_a_sign_is_decoded_from_the_first_row() -> None:
    """Also before a row has told its coding."""
    fields = {"unit": "count", "counts_per_turn": 4096, "resolution": 1.5e-3}
    rig = load_rig("capstan-joint")
    rig = rig.with_values({f"sensors.0.{name}": value for name, value in fields.items()})
    counts = np.round(-80.0 + 200.0 * (1.0 - np.cos(2.0 * TIME)))
    flagged = np.where(counts < 0, 2.0**15 - counts, counts)
    columns = (rig.log.time.column, *(sensor.log_column for sensor in rig.sensors[:2]))
    with pytest.warns(DistalWarning, match="the first at 0 s"):
        log = read_log(pl.DataFrame(dict(zip(columns, (TIME, flagged, 0.01 * FORCE)))), rig)
    np.testing.assert_allclose(log.channels[rig.sensors[0].name], counts * 2 * np.pi / 4096)


def test_episodes_without_a_time_are_learned_with_a_rate(tmp_path: Path) -> None:
    """The rig says where later logs have theirs."""
    joint = np.rad2deg(0.6 * np.sin(2.0 * TIME) + 0.2 * np.sin(5.0 * TIME))
    paths = [tmp_path / f"run_{k}.csv" for k in range(3)]
    for k, path in enumerate(paths):
        angle = joint + 5.0 * np.sin((1.0 + k) * TIME)
        noise = np.random.default_rng(k).normal(0.0, 0.05, N)
        pl.DataFrame({"motor [deg]": 1.3 * angle, "joint [deg]": angle + noise}).write_csv(path)
    with pytest.raises(LogError, match="say how many come in a second, as --rate 50"):
        rig_from_logs(paths)
    rig = rig_from_logs(paths, rate=100.0).rig
    np.testing.assert_allclose(read_log(paths[0], rig).time, TIME, atol=1e-9)
    assert rig.sensors[0].rate == pytest.approx(100.0)

"""What columns are, by their names, units and values."""

from typing import Any

import numpy as np
import pytest

from distal.errors import LogError
from distal.from_logs.column_names import ROLES, _step, name_evidence, value_evidence, with_families
from distal.from_logs.motion_data import RawLog
from distal.from_logs.rig_from_logs import Overrides, column_roles
from tests.from_logs.logs import Floats, finger

NO_OVERRIDES = Overrides(drives={})


@pytest.mark.parametrize(
    ("header", "role", "unit", "subject"),
    [
        ("x_mcp_f", "position", None, "mcp_f"),
        ("F_mcp_f", "effort", None, "mcp_f"),
        ("F_a", "effort", None, "a"),
        ("servo_3_dps", "other", None, "3"),
        ("servo_3_degC", "other", "degC", "3"),
        ("motor_state[0].ddq", "other", None, "0"),
        ("1.POSITION", "position", None, "1"),
        ("1.Q_CURRENT", "effort", None, "1"),
        ("Node 1 - Position [qc]", "position", "count", "node_1"),
        ("cur_l_mA", "effort", "mA", "l"),
        ("Strom links [mA]", "effort", "mA", "links"),
        ("couple_moteur (mN m)", "effort", "mN m", ""),
        ("posición_motor_2 [ticks]", "position", "count", "2"),
        ("Gelenkwinkel", "angle", None, ""),
        ("Motorwinkel2_deg", "position", "deg", "2"),
        ("Seilkraft/N", "effort", "N", ""),
        ("corsa1_mm", "position", "mm", "1"),
        ("flexor_ticks", "position", "count", "flexor"),
        ("joint_pos", "angle", None, ""),
        ("motor_angle_deg", "position", "deg", ""),
        ("theta_true_deg", "angle", "deg", ""),
        ("tau_true_Nm", "other", "N m", ""),
        ("zeit_ms", "time", "ms", ""),
        ("ms", "time", "ms", ""),
        ("soll_position", "command", None, ""),
        ("lc1_g", "effort", "gf", "1_g"),
        ("supply [V]", "other", "V", "supply"),
        ("load_2 [%]", "effort", "%", "2"),
        ("humidity [%]", "other", "%", ""),
        ("cmd_current [mA]", "command", "mA", ""),
        ("joint_torque", "effort", None, ""),
        ("joint_1_encoder [deg]", "angle", "deg", "1"),
        ("joint_1_motor_angle", "position", None, "1"),
        ("proximal tendon [mm]", "position", "mm", "proximal"),
        ("Motorwinkel_2/°", "position", "deg", "2"),
        ("τ1", "effort", None, "1"),
        ("θ2 [deg]", "angle", "deg", "2"),
        ("joint1_velocity [deg/s]", "other", None, "1"),
        ("F_a [grams]", "effort", "gf", "a"),
        ("observation.state.motor_position_deg", "position", "deg", ""),
        ("action.finger_deg", "command", "deg", "finger"),
    ],
)
def test_a_name_says_role_unit_and_whose_it_is(
    header: str, role: str, unit: str | None, subject: str
) -> None:
    found = name_evidence(header)
    best = max(found.scores, key=lambda each: found.scores[each])
    assert best == role
    assert found.unit == unit
    if header != "lc1_g":
        assert found.subject == subject


def taken(*logs: dict[str, Floats], said: Overrides = NO_OVERRIDES) -> dict[str, Any]:
    """Return what the columns of logs are taken for, by their headers."""
    raw = [RawLog(f"{k}", columns) for k, columns in enumerate(logs)]
    return {column.header: column for column in column_roles(raw, said)}


def test_a_finger_is_read_without_a_rig() -> None:
    found = taken(finger(0), finger(1))
    assert found["t_ms"].role == "time"
    assert [found[f"x_{n}_mm"].role for n in "abc"] == ["position"] * 3
    assert [found[f"F_{n}"].role for n in "abc"] == ["effort"] * 3
    assert [found[f"F_{n}"].part for n in "abc"] == ["a", "b", "c"]
    assert [found[f"{n}_deg"].role for n in ("mcp", "pip")] == ["angle"] * 2
    assert found["x_a_mm"].unit == "mm"
    assert found["F_a"].unit == "N"
    assert "likely" in found["F_a"].in_words  # no header says newtons


def test_current_by_size_alone_is_a_guess_and_said() -> None:
    columns = finger(1)
    columns["current_a"] = columns.pop("F_a") * 40.0
    columns["motor_a_deg"] = columns.pop("x_a_mm") * 10.0
    found = taken(columns)
    assert found["current_a"].unit == "mA"
    assert "mA (a guess)" in found["current_a"].in_words


def test_a_current_of_a_drive_in_a_line_is_a_force_of_a_taken_scale() -> None:
    columns = finger(1)
    columns["cur_a_mA"] = columns.pop("F_a") * 40.0
    columns["F_b [mA]"] = columns.pop("F_b") * 40.0
    found = taken(columns)
    assert (found["cur_a_mA"].role, found["cur_a_mA"].unit) == ("effort", "cN")
    assert found["F_b [mA]"].role == "other"  # its header says what a slider's sensor cannot read


def test_columns_whose_names_say_nothing_are_passed_over_beside_named_ones() -> None:
    """Also one that leads a drive as its command would, and one of a unit that nobody knows."""
    columns = finger(2)
    position = columns["x_a_mm"]
    columns["y_a"] = np.concatenate([position[10:], np.full(10, position[-1])])
    columns["y_b [wibble]"] = 2.0 * columns["y_a"]
    found = taken(columns)
    assert found["x_a_mm"].role == "position"
    assert found["y_a"].role == "command"
    assert found["y_b [wibble]"].role == "other"


@pytest.mark.parametrize(
    "names",
    [
        *("mcp_deg pip_deg", "index_deg middle_deg", "jaw_left jaw_right", "upper_deg lower_deg"),
        *("f1_mcp_flex f1_pip_flex", "bend_deg twist_deg", "thumb_ip thumb_mcp"),
    ],
)
def test_a_joint_that_goes_ahead_of_another_is_no_command_of_it(names: str) -> None:
    """The joints of an underactuated finger go alike, and one of them first."""
    columns = finger(2)
    first = columns.pop("mcp_deg")
    del columns["pip_deg"]
    late = np.concatenate([np.full(10, first[0]), first[:-10]])
    columns |= dict(zip(names.split(), (first, late)))
    found = taken(columns)
    assert {found[name].role for name in names.split()} == {"angle"}


def polish(seed: int) -> dict[str, Floats]:
    """Two motors and two joints in a language that no list has: angle, set angle and current of a
    motor (silnik), and the angle of a joint (staw).
    """
    rng = np.random.default_rng(seed)
    time = 0.02 * np.arange(600)
    columns = {"czas_ms": 1000.0 * time}
    for k in (1, 2):
        rates = rng.uniform(0.3, 1.2, 3)
        phases = rng.uniform(0.0, 6.0, 3)
        wave = sum(20.0 * np.sin(r * time * 2.0 + p) for r, p in zip(rates, phases))
        moved = np.interp(time - 0.04, time, wave)
        columns[f"kat_silnika_{k}_deg"] = moved + rng.normal(0.0, 0.02, 600)
        columns[f"kat_zadany_silnika_{k}_deg"] = np.asarray(wave)
        columns[f"predkosc_silnika_{k}"] = np.gradient(moved, time)
        columns[f"prad_silnika_{k}_mA"] = 5.0 * np.cos(wave / 20.0) + rng.normal(0.0, 1.0, 600)
        columns[f"kat_stawu_{k}_deg"] = 0.6 * moved + rng.normal(0.0, 0.1, 600)
    return columns


def test_families_and_values_say_what_no_list_of_words_does() -> None:
    found = {name: column.role for name, column in taken(*map(polish, range(3))).items()}
    for k in (1, 2):
        assert found[f"kat_silnika_{k}_deg"] == "position"
        assert found[f"kat_zadany_silnika_{k}_deg"] == "command"
        assert found[f"predkosc_silnika_{k}"] == "other"
        assert found[f"prad_silnika_{k}_mA"] == "effort"
        assert found[f"kat_stawu_{k}_deg"] == "angle"


def test_what_goes_as_another_columns_speed_is_no_position() -> None:
    """`motor1_w` is called as a motor's position could be."""
    columns = {"t_ms": polish(1)["czas_ms"]}
    names = {
        "kat_silnika_1_deg": "motor1_a",
        "predkosc_silnika_1": "motor1_w",
        "prad_silnika_1_mA": "motor1_mA",
        "kat_stawu_1_deg": "joint1_deg",
    }
    columns |= {name: polish(1)[header] for header, name in names.items()}
    found = taken(columns)
    assert found["motor1_a"].role == "position"
    assert found["motor1_w"].role == "other"


@pytest.mark.parametrize("others", ["position", "angle"])
def test_an_encoder_of_a_finger_is_what_the_other_names_leave(others: str) -> None:
    """`encoder_mcp` may be that of a motor or of a joint."""
    columns = finger(2)
    changed, left = ("mcp_deg", "x_a_mm") if others == "position" else ("x_a_mm", "mcp_deg")
    columns["encoder_mcp"] = columns.pop(changed)
    kept = {n: c for n, c in columns.items() if (n[0] in "xF") == (left[0] in "xF") or n == "t_ms"}
    kept["encoder_mcp"] = columns["encoder_mcp"]
    found = taken(kept)
    assert found["encoder_mcp"].role == {"position": "angle", "angle": "position"}[others]
    assert found["encoder_mcp"].sureness != "a guess"


@pytest.mark.parametrize("wide", [30.0, 3.0])
def test_angles_without_a_unit_have_that_of_the_widest(wide: float) -> None:
    """An angle of 3 may be in radians or degrees; beside one of 60 it is in degrees."""
    columns = finger(2)
    columns["mcp"] = columns.pop("mcp_deg")
    columns["pip"] = columns.pop("pip_deg") * wide / 30.0
    found = taken(columns)
    assert found["mcp"].unit == found["pip"].unit == "deg"


@pytest.mark.parametrize(("turn", "wraps"), [(4096.0, True), (4096.0, False), (360.0, True)])
def test_a_column_wraps_after_a_turn_that_is_seen(turn: float, wraps: bool) -> None:
    time = np.arange(0.0, 20.0, 0.01)
    count = np.round(1.5 * turn * np.sin(0.5 * time))
    found = value_evidence([np.mod(count, turn) if wraps else count])
    assert found.turn == (turn if wraps else None)


def test_columns_whose_names_say_nothing_stay_a_guess() -> None:
    names = {"t_ms": "c0", "x_a_mm": "a0", "x_b_mm": "a1", "mcp_deg": "d0", "pip_deg": "d1"}
    logs = [{name: finger(k)[old] for old, name in names.items()} for k in range(2)]
    assert {c.sureness for c in taken(*logs).values() if c.role != "time"} == {"a guess"}


def test_what_a_user_says_overrules() -> None:
    said = Overrides(truth=("x_a_mm",), drives={"mcp_deg": "deg"}, ignore=("F_b",))
    found = taken(finger(3), said=said)
    assert found["x_a_mm"].role == "angle"
    assert found["mcp_deg"].role == "position"
    assert found["F_b"].role == "other"
    with pytest.raises(LogError, match=r"no column 'x_a_m'.*x_a_mm"):
        taken(finger(3), said=Overrides(truth=("x_a_m",), drives={}))


def test_without_a_time_it_says_so() -> None:
    columns = finger(4)
    columns["t_ms"] = np.random.default_rng(0).normal(size=len(columns["t_ms"]))
    with pytest.raises(LogError, match=r"'t_ms' goes back, .*after sample \d+: "):
        taken(columns)
    columns["column"] = columns.pop("t_ms")
    columns["dones"] = np.append(np.zeros(len(columns["column"]) - 1), 1.0)  # ends an episode
    with pytest.raises(LogError, match="none is the time"):
        taken(columns)
    columns["sample"] = np.arange(len(columns["column"]), dtype=float)
    with pytest.raises(LogError, match="'sample' counts rows"):
        taken(columns)


def test_a_second_column_called_a_time_may_be_anything() -> None:
    """A laser's `time_increment` beside joints has the same value in a few rows, and none else."""
    columns = finger(4)
    gaps = np.arange(len(columns["t_ms"])) % 5 > 0
    columns["/scan.time_increment"] = np.where(gaps, np.nan, 1e-3)
    found = taken(columns)
    assert found["t_ms"].role == "time"
    assert found["/scan.time_increment"].role == "other"


@pytest.mark.parametrize(
    ("header", "unit"),
    [("motorCurrentA", "A"), ("corrente1", "A"), ("fuerza1", "N"), ("tau2", "N m"), ("u1", "N")],
)
def test_the_unit_of_an_effort_without_one_is_that_of_its_word(header: str, unit: str) -> None:
    columns = finger(1)
    columns[header] = columns.pop("F_a") / 10.0
    found = taken(columns)
    assert found[header].role == "effort"
    assert found[header].unit == {"A": "daN"}.get(unit, unit)  # of a drive in a line: a force


@pytest.mark.parametrize(
    ("headers", "drives"),
    [
        ("t enc_flex enc_ext cur_flex cur_ext mcp_angle", "enc_flex enc_ext"),
        (
            "t flex_present_position flex_present_current_mA ext_present_position index_mcp",
            "flex_present_position ext_present_position",
        ),
        ("t p1 i1 q1", "p1"),
        ("t theta_m1 i_m1 theta_joint", "theta_m1"),
        ("t wrist_flex.pos action.wrist_flex.pos camera_deg", "wrist_flex.pos"),
        ("t motor_state[0].q motor_state[0].dq motor_state[0].tau_est mocap", "motor_state[0].q"),
        ("t enc_1 cur_1 angle_1", "enc_1"),
        ("t motor_pos_3 current_3 angle_3", "motor_pos_3"),
    ],
)
def test_a_family_with_a_current_or_a_command_is_a_drive(headers: str, drives: str) -> None:
    names = with_families({header: name_evidence(header) for header in headers.split()})
    best = {header: max(ROLES, key=lambda r: name.scores[r]) for header, name in names.items()}
    assert [header for header, role in best.items() if role == "position"] == drives.split()
    assert list(best.values()).count("angle") == 1
    assert best[headers.split()[-1]] == "angle"


@pytest.mark.parametrize(
    ("headers", "angles"),
    [
        (
            "t x1 u1 true_theta true_external_torque true_position_left true_tension_left",
            "true_theta",
        ),
        ("t x u true_pos", "true_pos"),
        ("t m1_pos true_pip_position true_mcp_position", "true_pip_position true_mcp_position"),
    ],
)
def test_truths_of_a_simulation_are_no_joints_but_for_the_angle(headers: str, angles: str) -> None:
    """A position that is called true is a joint's where no other column is called a true angle."""
    names = headers.split()
    found = with_families({name: name_evidence(name, names) for name in names})
    assert [name for name in names if found[name].best == "angle"] == angles.split()


def test_what_a_drive_should_do_is_no_joint_where_another_column_is() -> None:
    headers = ("enc_flex", "cur_flex", "ref_flex")
    names = with_families({header: name_evidence(header) for header in headers})
    assert names["ref_flex"].scores["angle"] > names["ref_flex"].scores["command"]
    names = with_families({header: name_evidence(header) for header in (*headers, "camera")})
    assert names["ref_flex"].scores["command"] > names["ref_flex"].scores["angle"]


def test_the_resolution_of_a_column() -> None:
    """Numbers on a grid that repeat have its step; noise has none, nor have two values."""
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 1.0, 2000)
    assert _step(0.1 * np.round(noise / 0.1)) == pytest.approx(0.1)
    assert _step(noise) == 0.0
    assert _step(np.sign(noise)) == 0.0


def test_where_a_user_names_some_the_others_are_none() -> None:
    """Unless their own names say so: here they say nothing of any column."""
    names = {"p1": 0.0, "p2": 1.0, "r1": 2.0, "a1": 3.0}
    time = np.arange(0.0, 5.0, 0.02)
    log = {"t": time} | {n: np.sin(time + k) for n, k in names.items()}
    said = Overrides(truth=("a1",), drives={"p1": "rad", "p2": "rad"})
    roles = {name: column.role for name, column in taken(log, said=said).items()}
    assert roles.pop("r1") not in ("position", "angle")
    assert roles == {"t": "time", "p1": "position", "p2": "position", "a1": "angle"}

"""MCAP and ROS bags: columns by topic and field, stamps merged; what is missing is named."""

from __future__ import annotations

import builtins
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_scenario, read_log, scenario_rig, simulate
from distal.errors import DistalWarning, LogError
from distal.logs import open_table
from distal.logs.tables import _stamped, recorded_columns
from tests.logs.recordings import Recorder, State, write_bag

TOPICS = {
    "x1": "/left.position[0]",
    "u1": "/left.effort[0]",
    "x2": "/right.position[0]",
    "u2": "/right.effort[0]",
}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"), 5).select(slice(0, 200))


@pytest.fixture(scope="module")
def named(rig: Rig) -> Rig:
    """The rig with columns by topic and field, as one writes it for a bag."""
    names = [sensor.name for sensor in rig.sensors]
    return rig.with_values(
        {f"sensors.{names.index(name)}.column": column for name, column in TOPICS.items()}
    )


def bag(
    log: Log, folder: Path, rig: Rig, late: float = 0.0, odd: dict[int, float] | None = None
) -> Path:
    """Write a bag of ROS 2: two topics of joint states, the right one `late` behind, with `odd`
    stamps in some of its messages, and one topic that nobody asked for.
    """
    factor = {s.name: 1e-3 if s.unit == "mm" else 1.0 for s in rig.sensors}

    def states() -> Iterator[State]:
        for k, time in enumerate(log.time):
            for number, side in enumerate(("left", "right"), start=1):
                at = round((1.7e9 + time + (late if side == "right" else 0.0)) * 1e9)
                if side == "right" and odd is not None and k in odd:
                    at = round(odd[k] * 1e9)
                names = f"x{number}", f"u{number}"
                x, u = (log.channels[name][k] / factor[name] for name in names)
                yield f"/{side}", at, round((1.7e9 + time) * 1e9) + 5_000_000, [side], [x], [u]

    return write_bag(folder, states())


def test_a_bag_of_ros_2(rig: Rig, named: Rig, log: Log, tmp_path: Path) -> None:
    path = bag(log, tmp_path / "run", rig)
    read = read_log(path, named)
    assert len(read) == len(log)
    np.testing.assert_allclose(read.time, log.time, atol=1e-6)
    for name in TOPICS:
        np.testing.assert_allclose(read.channels[name], log.channels[name], rtol=1e-12)
    np.testing.assert_allclose(estimate(read, named).theta, estimate(log, rig).theta, atol=1e-5)
    database = next(path.glob("*.db3"))
    assert len(read_log(database, named)) == len(log)


def test_stamps_that_nearly_agree_are_one_row(
    rig: Rig, named: Rig, log: Log, tmp_path: Path
) -> None:
    near = read_log(bag(log, tmp_path / "near", rig, late=0.0005), named)
    assert len(near) == len(log)
    far = read_log(bag(log, tmp_path / "far", rig, late=0.004), named)
    assert len(far) == 2 * len(log)
    assert np.isnan(far.channels["x1"]).sum() == np.isnan(far.channels["x2"]).sum() == len(log)


@pytest.mark.parametrize("k", [0, 1, 77, 199])
@pytest.mark.parametrize("stamp", [12.5, 1.8e9, 2.1e9])
def test_a_wild_stamp_in_a_bag_costs_its_message_only(
    rig: Rig, named: Rig, log: Log, tmp_path: Path, k: int, stamp: float
) -> None:
    path = bag(log, tmp_path / "run", rig, odd={k: stamp})
    with pytest.warns(DistalWarning, match=rf"run: message {k + 1} of /right left out") as said:
        read = read_log(path, named)
    assert len(said) == 1
    assert len(read) == len(log)
    for name in TOPICS:
        expected = np.array(log.channels[name])
        if name.endswith("2"):
            expected[k] = np.nan
        np.testing.assert_allclose(read.channels[name], expected, rtol=1e-12)


def test_a_message_that_came_late_stands_where_its_stamp_is(log: Log) -> None:
    """A network may bring messages in another order: none is lost, nothing is said."""
    order = [*range(50), 52, 50, 51, *range(53, 120), 121, 120, *range(122, 200)]
    readings = {"/a.x": [(i, round(log.time[k] * 1e9), 10**7 * i, k) for i, k in enumerate(order)]}
    stamps, values = _stamped(Path("run.mcap"), readings)["/a.x"]  # type: ignore[arg-type]
    np.testing.assert_array_equal(stamps, np.round(log.time[values.astype(int)] * 1e9))
    assert len(stamps) == len(log)


def test_a_topic_on_another_clock_is_named(rig: Rig, named: Rig, log: Log, tmp_path: Path) -> None:
    """The others are read; where the rig needs it, it says what is missing."""
    path = bag(log, tmp_path / "run", rig, late=-1.6e9)
    said = r"/right left out: its clock begins at 100000000 s, the others' at 1700000000"
    with pytest.warns(DistalWarning, match=said):
        read = open_table(path, [*TOPICS.values()])
    assert read.names == ("t", TOPICS["x1"], TOPICS["u1"])
    with (
        pytest.warns(DistalWarning, match=said),
        pytest.raises(LogError, match=r"column '/right.position\[0\]' is missing"),
    ):
        read_log(path, named)


def test_what_a_bag_lacks_is_named(rig: Rig, named: Rig, log: Log, tmp_path: Path) -> None:
    path = bag(log, tmp_path / "run", rig)
    with pytest.raises(
        LogError, match=r"columns are /topic\.field, the topics are /chatter, /left, /right"
    ):
        read_log(path, rig)
    at = [sensor.name for sensor in rig.sensors].index("u2")
    with pytest.raises(LogError, match=r"column '/right\.effort\[3\]' is missing"):
        read_log(path, named.with_values({f"sensors.{at}.column": "/right.effort[3]"}))
    with pytest.raises(LogError, match="no number; name one element"):
        read_log(path, named.with_values({f"sensors.{at}.column": "/right.effort"}))
    with pytest.raises(LogError, match="is not there"):
        read_log(tmp_path / "absent.mcap", named)
    (tmp_path / "broken.mcap").write_bytes(b"\x89MCAP0\r\n nonsense")
    with (
        pytest.raises(LogError, match=r"broken\.mcap: no message .* the topics are none"),
        pytest.warns(DistalWarning, match="has no end"),
    ):
        read_log(tmp_path / "broken.mcap", named)


def mcap_of_vectors(rig: Rig, log: Log, path: Path, topic: str) -> Rig:
    """Write a file of MCAP with a topic of ROS 2 for each drive, whose names begin with `topic`,
    and a service event that no library can decode; return the rig with columns by topic and field.
    """
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    kind = "geometry_msgs/msg/Vector3"
    made = store.types[kind]
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096)
        writer.start()
        odd = writer.register_schema("a/srv/Event", "ros2msg", b"a/srv/Unknown request\n")
        event = writer.register_channel("/service_event", "cdr", odd)
        writer.add_message(event, 0, b"\0\1\0\0", 0)
        schema = writer.register_schema(kind, "ros2msg", b"float64 x\nfloat64 y\nfloat64 z\n")
        channels = {n: writer.register_channel(f"{topic}{n}", "cdr", schema) for n in (1, 2)}
        for k, time in enumerate(log.time):
            for n, channel in channels.items():
                x, u = (log.channels[f"{letter}{n}"][k] for letter in "xu")
                data = store.serialize_cdr(made(x=float(x), y=float(u), z=0.0), kind)
                writer.add_message(channel, round(time * 1e9), bytes(data), round(time * 1e9))
        writer.finish()
    names = [sensor.name for sensor in rig.sensors]
    values = {}
    for n in (1, 2):
        values |= {
            f"sensors.{names.index(f'{k}{n}')}.column": f"{topic}{n}.{f}"
            for k, f in (("x", "x"), ("u", "y"))
        }
        values |= {
            f"sensors.{names.index(f'x{n}')}.unit": "m",
            f"sensors.{names.index(f'u{n}')}.unit": "N",
        }
    return rig.with_values(values)


@pytest.mark.parametrize("topic", ["/drive", "drive"])
def test_messages_of_ros_in_mcap(rig: Rig, log: Log, tmp_path: Path, topic: str) -> None:
    """A file of MCAP with messages of ROS 2 holds their definitions. What nobody asks for is passed
    over, and a topic needs no slash.
    """
    path = tmp_path / "run.mcap"
    by_topic = mcap_of_vectors(rig, log, path, topic)
    read = read_log(path, by_topic)
    for name in TOPICS:
        np.testing.assert_allclose(read.channels[name], log.channels[name], rtol=1e-12)
    assert recorded_columns(path) == [f"{topic}{n}.{field}" for n in (1, 2) for field in "xyz"]
    at = [sensor.name for sensor in rig.sensors].index("x1")
    with pytest.raises(LogError, match=r"a message of '/service_event' cannot be decoded"):
        read_log(path, by_topic.with_values({f"sensors.{at}.column": "/service_event.x"}))


@pytest.mark.parametrize("behind", [b"", 5000 * b"\0", 5000 * b"\xff"])
def test_a_recording_that_was_cut_off(rig: Rig, log: Log, tmp_path: Path, behind: bytes) -> None:
    """Wherever that was, in a record or between two, and whatever a disk has left behind it."""
    path = tmp_path / "run.mcap"
    by_topic = mcap_of_vectors(rig, log, path, "/drive")
    whole = path.read_bytes()
    for cut in (*range(len(whole) // 2, len(whole) // 2 + 40), *range(len(whole) - 30, len(whole))):
        path.write_bytes(whole[:cut] + behind)
        with pytest.warns(DistalWarning, match=r"run\.mcap: has no end, recording or copying"):
            read = read_log(path, by_topic)
        assert len(read) > 0.2 * len(log)
        seen = log.channels["x1"][: len(read)]
        np.testing.assert_allclose(read.channels["x1"], seen, rtol=1e-12)
    assert len(read) == len(log)
    path.write_bytes(whole[:8])
    with (
        pytest.raises(LogError, match="the topics are none"),
        pytest.warns(DistalWarning, match="has no end"),
    ):
        read_log(path, by_topic)
    path.write_bytes(b"<!DOCTYPE html>")
    with pytest.raises(LogError, match=r"is no MCAP file, since it begins with b'<!DOCTYP'"):
        read_log(path, by_topic)


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.h5", "run.mcap", "run.db3"])
def test_a_pointer_of_git_lfs(rig: Rig, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    with pytest.raises(LogError, match="is a pointer of Git LFS; fetch the log itself"):
        read_log(path, rig)


SAMPLE_TOPIC = "robot/sample"


def recorded(path: Path, stamps: list[float], **changed: object) -> Path:
    recorder = Recorder(path)
    for k, stamp in enumerate(stamps):
        message = {
            "t": stamp,
            "x1": 1e-5 * k,
            "u1": 5.0 + k % 3,
            "x2": -1e-5 * k,
            "u2": 5.0 - k % 3,
            **changed,
        }
        recorder.add(SAMPLE_TOPIC, stamp if isinstance(stamp, float) else 0.0, message)
    recorder.close()
    return path


def test_a_clock_that_was_set_back_is_said(rig: Rig, tmp_path: Path) -> None:
    """By half a second too, and where a table's clock was."""
    for back in (0.0, 2.5):
        first, second = (
            [0.01 * k for k in range(300)],
            [back + 0.005 + 0.01 * k for k in range(100)],
        )
        path = recorded(tmp_path / f"back_{back}.mcap", first + second)
        with pytest.warns(DistalWarning, match=r"set back 1 times; only part 1 of 2 is read"):
            assert len(read_log(path, rig)) == 300
    rows = [
        f"{stamp},{1e-5 * k},{5 + k % 3},{-1e-5 * k},{5 - k % 3}"
        for k, stamp in enumerate(first + second)
    ]
    table = tmp_path / "back.csv"
    table.write_text("\n".join(["t,x1,u1,x2,u2", *rows]))
    with pytest.warns(DistalWarning, match=r"back.csv: the clock was set back 1 times"):
        log = read_log(table, rig)
    np.testing.assert_array_equal(log.time, first)


def test_where_a_clock_was_set_back_all_topics_are_cut() -> None:
    """At its messages, whatever the recorder's clock and those of the others do."""
    seconds = (1, 2, 3, 4, 5, 1, 2, 3)
    back = [(2 * i, k * 10**9, k * 10**9, 1.0) for i, k in enumerate(seconds)]
    too = [(2 * i + 1, k * 10**9, k * 10**9, 1.0) for i, k in enumerate(seconds)]
    never = [(2 * i + 1, k * 10**9, k * 10**9, 2.0) for i, k in enumerate(range(1, 9))]
    seldom = [too[1], too[6]]
    for other, left in ((too, 4), (never, 4), (seldom, 1)):
        with pytest.warns(DistalWarning, match="set back 1 times; only part 1 of 2 is read"):
            parts = _stamped(Path("run.mcap"), {"/a.x": back, "/b.x": other})  # type: ignore[dict-item]
        assert [len(stamps) for stamps, _ in parts.values()] == [5, left]


def test_a_recorder_without_a_clock_tells_no_clocks_apart() -> None:
    """Who converts logs may write one time of recording for all messages."""
    first = [(2 * k, k * 10**7, 0, 1.0) for k in range(100)]
    second = [(2 * k + 1, k * 10**7 + 4 * 10**6, 0, 2.0) for k in range(100)]
    found = _stamped(Path("two.mcap"), {"/a.x": first, "/b.x": second})  # type: ignore[dict-item]
    assert list(found) == ["/a.x", "/b.x"]


def test_odd_messages_are_one_line(rig: Rig, tmp_path: Path) -> None:
    for stamp, said in (
        ("abc", "'t' is 'abc'"),
        (1.7e12, "is no time; what unit"),
        ({"sec": 1}, "a number is expected"),
    ):
        path = recorded(tmp_path / "odd.mcap", [0.0, 0.01, stamp])  # type: ignore[list-item]
        with pytest.raises(LogError, match=said):
            read_log(path, rig)
    path = recorded(tmp_path / "text.mcap", [0.0, 0.01, 0.02], x1="0.001")
    np.testing.assert_allclose(read_log(path, rig).channels["x1"], 1e-3, rtol=0.01)


def test_columns_named_by_topic_are_found_in_json(
    named: Rig, rig: Rig, log: Log, tmp_path: Path
) -> None:
    """Of messages whose members are columns of a rig of ROS, and of nested objects."""
    from distal.logs.messages import find

    column_of = {sensor.name: sensor.log_column for sensor in named.sensors}
    recorder = Recorder(tmp_path / "run.mcap")
    for k, time in enumerate(log.time):
        message = {column_of[name]: float(log.channels[name][k]) for name in TOPICS}
        recorder.add(SAMPLE_TOPIC, float(time), {"t": float(time), **message})
    recorder.close()
    again = read_log(tmp_path / "run.mcap", named)
    for name in TOPICS:
        np.testing.assert_allclose(again.channels[name], log.channels[name], rtol=1e-12)
    for message in (
        {"/left": {"position": [3.0]}},
        {"left": {"position": [3.0]}},
        {"/left.position[0]": 3.0},
    ):
        assert find(message, "/left.position[0]") == 3.0
    assert find({"a": [1]}, "/left.position[0]") is None
    for odd in ("a[²]", "a[١]", "a[99999999999999999999]", "a[-1]", "a" + ".a" * 5000):
        assert find({"a": [1]}, odd) is None


def test_a_simulation_that_begins_at_zero(named: Rig, tmp_path: Path) -> None:
    """A header of zero is a stamp where the others of its topic are."""
    states = [
        (f"/{side}", k * 10_000_000, 1_700_000_000_000_000_000 + k * 11_000_000, "a", [1e-3], [2.0])
        for k in range(50)
        for side in ("left", "right")
    ]
    read = read_log(write_bag(tmp_path / "sim", states), named)
    np.testing.assert_allclose(read.time, 0.01 * np.arange(50), atol=1e-9)


def test_without_the_packages_it_says_what_to_install(
    named: Rig, rig: Rig, log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = bag(log, tmp_path / "run", rig)
    (tmp_path / "run.mcap").write_bytes(b"")
    real = builtins.__import__

    def absent(name: str, *rest: object, **more: object) -> object:
        if name.split(".")[0] in ("mcap", "rosbags"):
            raise ImportError(name)
        return real(name, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", absent)
    columns = [sensor.log_column for sensor in named.sensors]
    with pytest.raises(LogError, match=r"pip install '\.\[ros\]'"):
        open_table(path, columns)
    with pytest.raises(LogError, match=r"pip install '\.\[mcap\]'"):
        open_table(tmp_path / "run.mcap", columns)


BY_NAME = {
    f"{kind}{number}": f"/joint_states[{side}.motor].{field}"
    for number, side in ((1, "left"), (2, "right"))
    for kind, field in (("x", "position"), ("u", "effort"))
}


def joints_bag(log: Log, folder: Path, apart: float, lost: tuple[int, str] | None = None) -> Path:
    """Write a bag with one topic of joint states: both joints in a message, their order now so, now
    so; or `apart` [s].
    """

    def states() -> Iterator[State]:
        for k, time in enumerate(log.time):
            sides = [("left", 1), ("right", 2)][:: 1 if k % 2 else -1]
            parts = [sides] if apart == 0.0 else [[sides[0]], [sides[1]]]
            for late, part in enumerate(parts):
                if lost == (k, part[0][0]):
                    continue
                at = round((1.7e9 + time + late * apart) * 1e9)
                names = ["gripper", *(f"{side}.motor" for side, _ in part)]
                x, u = (
                    [9.0, *(log.channels[f"{kind}{number}"][k] for _, number in part)]
                    for kind in "xu"
                )
                yield "/joint_states", at, at, names, x, u

    return write_bag(folder, states())


@pytest.fixture(scope="module")
def by_name(rig: Rig) -> Rig:
    names = [sensor.name for sensor in rig.sensors]
    return rig.with_values(
        {f"sensors.{names.index(name)}.column": column for name, column in BY_NAME.items()}
    )


@pytest.mark.parametrize("apart", [0.0, 0.003])
def test_joints_by_their_names(
    rig: Rig, by_name: Rig, log: Log, tmp_path: Path, apart: float
) -> None:
    """Wherever they stand in a message, and also where each has a message of its own; the original
    stamps are kept.
    """
    read = read_log(joints_bag(log, tmp_path / "run", apart), by_name)
    assert len(read) == len(log)
    np.testing.assert_allclose(read.time, log.time, atol=1e-6)
    for name in BY_NAME:
        np.testing.assert_allclose(read.channels[name], log.channels[name], rtol=1e-12)
    assert read.stamps is not None
    np.testing.assert_allclose((read.stamps - read.stamps[0]) * 1e-9, log.time, atol=1e-6)
    assert abs(read.stamps[0] - 1_700_000_000_000_000_000) < 1000


@pytest.mark.parametrize(("side", "own", "other"), [("right", "x2", "x1"), ("left", "x1", "x2")])
def test_a_joint_whose_message_is_lost_costs_its_own_value_only(
    by_name: Rig, log: Log, tmp_path: Path, side: str, own: str, other: str
) -> None:
    """The next message of the lost joint, an interval later, is not taken for the one that is
    missing.
    """
    read = read_log(joints_bag(log, tmp_path / "run", 0.003, lost=(50, side)), by_name)
    assert len(read) == len(log)
    assert np.flatnonzero(np.isnan(read.channels[own])).tolist() == [50]
    np.testing.assert_allclose(
        np.delete(read.channels[own], 50), np.delete(log.channels[own], 50), rtol=1e-12
    )
    np.testing.assert_allclose(read.channels[other], log.channels[other], rtol=1e-12)


def test_a_name_that_no_message_has(by_name: Rig, log: Log, tmp_path: Path) -> None:
    at = [sensor.name for sensor in by_name.sensors].index("u2")
    wrong = by_name.with_values({f"sensors.{at}.column": "/joint_states[right.moter].effort"})
    with pytest.raises(
        LogError, match=r"column '/joint_states\[right\.moter\]\.effort' is missing"
    ):
        read_log(joints_bag(log, tmp_path / "run", 0.0), wrong)


@pytest.mark.parametrize(
    "odd",
    [
        {"m": [[1, 2], [3]]},
        {"name": [1, None, ["x"]], "position": [0.5]},
        {"name": ["a", "b"], "pos[left]": 1.0},
        {"m": [{"n": 1}, 2]},
    ],
)
def test_odd_json_that_nobody_asked_for(odd: dict[str, object], tmp_path: Path) -> None:
    """Whatever its shape, it hides no column of the others."""
    recorder = Recorder(tmp_path / "run.mcap")
    for k in range(3):
        recorder.add(SAMPLE_TOPIC, 0.1 * k, {"t": 0.1 * k, "x1": 1.0})
        recorder.add("robot/estimate", 0.1 * k, odd)
    recorder.close()
    assert f"{SAMPLE_TOPIC}.x1" in recorded_columns(tmp_path / "run.mcap")

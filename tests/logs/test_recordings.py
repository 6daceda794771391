"""MCAP and ROS bags: columns by topic and field, stamps merged; what is missing is named."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, load_scenario, read_log, scenario_rig, simulate
from distal.errors import DistalWarning, LogError
from distal.logs import open_table
from distal.logs.messages import find
from distal.logs.tables import Stamped, _stamped, recorded_columns
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


def with_columns(rig: Rig, columns: dict[str, str]) -> Rig:
    return rig.with_values({f"sensors.{name}.column": column for name, column in columns.items()})


@pytest.fixture(scope="module")
def named(rig: Rig) -> Rig:
    """The rig with columns by topic and field, as one writes it for a bag."""
    return with_columns(rig, TOPICS)


def check(read: Log, log: Log, **missing: int) -> None:
    """Check that a log was read as it was written, but for the row that a sensor lacks."""
    # a row in which one is missing is that of the others
    np.testing.assert_allclose(read.time, log.time, atol=4e-3 if missing else 1e-6)
    for name in TOPICS:
        expected = np.array(log.channels[name])
        if name in missing:
            expected[missing[name]] = np.nan
        np.testing.assert_allclose(read.channels[name], expected, rtol=1e-12)


def bag(log: Log, folder: Path, late: float = 0.0) -> Path:
    """Write a bag of ROS 2: two topics of joint states, the right one `late` behind, and one topic
    that nobody asked for.
    """

    def states() -> Iterator[State]:
        for k, time in enumerate(log.time):
            for number, side, after in ((1, "left", 0.0), (2, "right", late)):
                x, u = (log.channels[f"{kind}{number}"][k] for kind in "xu")
                recorded = round((1.7e9 + time) * 1e9) + 5_000_000
                stamp = round((1.7e9 + time + after) * 1e9)
                yield f"/{side}", stamp, recorded, [side], [x], [u]

    return write_bag(folder, states())


def test_a_bag_of_ros_2(named: Rig, log: Log, tmp_path: Path) -> None:
    path = bag(log, tmp_path / "run")
    check(read_log(path, named), log)
    check(read_log(next(path.glob("*.db3")), named), log)


def test_stamps_that_nearly_agree_are_one_row(named: Rig, log: Log, tmp_path: Path) -> None:
    assert len(read_log(bag(log, tmp_path / "near", late=0.0005), named)) == len(log)
    far = read_log(bag(log, tmp_path / "far", late=0.004), named)
    assert len(far) == 2 * len(log)
    assert np.isnan(far.channels["x1"]).sum() == np.isnan(far.channels["x2"]).sum() == len(log)


def test_a_message_that_came_late_stands_where_its_stamp_is() -> None:
    """A network may bring messages in another order: none is lost, nothing is said."""
    order = [*range(50), 52, 50, 51, *range(53, 120), 121, 120, *range(122, 200)]
    messages = [(i, k * 10**7, i * 10**7, float(k)) for i, k in enumerate(order)]
    stamps, values = stamped(a=messages)["/a.x"]
    np.testing.assert_array_equal(stamps, 10**7 * values)
    assert len(stamps) == len(order)


def test_a_topic_on_another_clock_is_named(named: Rig, log: Log, tmp_path: Path) -> None:
    """The others are read; where the rig needs it, it says what is missing."""
    path = bag(log, tmp_path / "run", late=-1.6e9)
    said = r"/right left out: its clock begins at 100000000 s, the others' at 1700000000"
    with pytest.warns(DistalWarning, match=said):
        read = open_table(path, [*TOPICS.values()])
    assert read.names == ("t", TOPICS["x1"], TOPICS["u1"])
    with (
        pytest.warns(DistalWarning, match=said),
        pytest.raises(LogError, match=r"column '/right.position\[0\]' is missing"),
    ):
        read_log(path, named)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (
            dict(zip(TOPICS, TOPICS)),
            r"columns are /topic\.field, the topics are /chatter, /left, /right",
        ),
        ({"u2": "/right.effort[3]"}, r"column '/right\.effort\[3\]' is missing"),
        ({"u2": "/right[moter].effort"}, r"column '/right\[moter\]\.effort' is missing"),
        ({"u2": "/right.effort"}, "no number; name one element"),
    ],
)
def test_what_a_bag_lacks_is_named(
    named: Rig, log: Log, tmp_path: Path, columns: dict[str, str], said: str
) -> None:
    with pytest.raises(LogError, match=said):
        read_log(bag(log, tmp_path / "run"), with_columns(named, columns))


def mcap_of_vectors(log: Log, path: Path, topic: str) -> None:
    """Write a file of MCAP with a topic of ROS 2 for each drive, whose names begin with `topic`,
    and a service event that no library can decode.
    """
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    kind = "geometry_msgs/msg/Vector3"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096)
        writer.start()
        odd = writer.register_schema("a/srv/Event", "ros2msg", b"a/srv/Unknown request\n")
        event = writer.register_channel("/service_event", "cdr", odd)
        writer.add_message(event, 0, b"\0\1\0\0", 0)
        schema = writer.register_schema(kind, "ros2msg", b"float64 x\nfloat64 y\nfloat64 z\n")
        channels = {n: writer.register_channel(f"{topic}{n}", "cdr", schema) for n in (1, 2)}
        for k, at in enumerate(np.rint(1e9 * log.time).astype(int).tolist()):
            for n, channel in channels.items():
                x, u = (float(log.channels[f"{letter}{n}"][k]) for letter in "xu")
                data = store.serialize_cdr(store.types[kind](x=x, y=u, z=0.0), kind)
                writer.add_message(channel, at, bytes(data), at)
        writer.finish()


@pytest.mark.parametrize("topic", ["/drive", "drive"])
def test_messages_of_ros_in_mcap(rig: Rig, log: Log, tmp_path: Path, topic: str) -> None:
    """A file of MCAP with messages of ROS 2 holds their definitions. What nobody asks for is passed
    over, and a topic needs no slash.
    """
    path = tmp_path / "run.mcap"
    mcap_of_vectors(log, path, topic)
    columns = {f"{kind}{n}": f"{topic}{n}.{f}" for n in (1, 2) for kind, f in ("xx", "uy")}
    by_topic = with_columns(rig, columns)
    check(read_log(path, by_topic), log)
    assert recorded_columns(path) == [f"{topic}{n}.{field}" for n in (1, 2) for field in "xyz"]
    with pytest.raises(LogError, match=r"a message of '/service_event' cannot be decoded"):
        read_log(path, with_columns(by_topic, {"x1": "/service_event.x"}))


@pytest.mark.parametrize("behind", [b"", 5000 * b"\0", 5000 * b"\xff"])
def test_a_recording_that_was_cut_off(rig: Rig, tmp_path: Path, behind: bytes) -> None:
    """Wherever that was, in a record or between two, and whatever a disk has left behind it."""
    path = recorded(tmp_path / "run.mcap", [0.01 * k for k in range(200)])
    whole, log = path.read_bytes(), read_log(path, rig)
    half, end = len(whole) // 2, len(whole)
    for cut in (*range(half, half + 40, 3), *range(end - 31, end, 3)):
        path.write_bytes(whole[:cut] + behind)
        with pytest.warns(DistalWarning, match=r"run\.mcap: has no end, recording or copying"):
            read = read_log(path, rig)
        assert len(read) > 0.2 * len(log)
        np.testing.assert_array_equal(read.channels["x1"], log.channels["x1"][: len(read)])
    assert len(read) == len(log)
    for begin in (whole[:8], b"\x89MCAP0\r\n nonsense"):
        path.write_bytes(begin)
        with (
            pytest.raises(LogError, match="the topics are none"),
            pytest.warns(DistalWarning, match="has no end"),
        ):
            read_log(path, rig)
    path.write_bytes(b"<!DOCTYPE html>")
    with pytest.raises(LogError, match=r"is no MCAP file, since it begins with b'<!DOCTYP'"):
        read_log(path, rig)
    path.unlink()
    with pytest.raises(LogError, match="cannot be read"):
        read_log(path, rig)


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.h5", "run.mcap", "run.db3"])
def test_a_pointer_of_git_lfs(rig: Rig, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    with pytest.raises(LogError, match="is a pointer of Git LFS; fetch the log itself"):
        read_log(path, rig)


SAMPLE_TOPIC = "robot/sample"


def recorded(path: Path, stamps: Sequence[object], **changed: object) -> Path:
    recorder = Recorder(path)
    for k, stamp in enumerate(stamps):
        sample = {"x1": 1e-5 * k, "u1": 5.0 + k % 3, "x2": -1e-5 * k, "u2": 5.0 - k % 3}
        time = stamp if isinstance(stamp, float) else 0.0
        recorder.add(SAMPLE_TOPIC, time, {"t": stamp, **sample, **changed})
    recorder.close()
    return path


@pytest.mark.parametrize("back", [0.0, 2.5])
def test_a_clock_that_was_set_back_is_said(rig: Rig, tmp_path: Path, back: float) -> None:
    """By half a second too."""
    stamps = np.concatenate([0.01 * np.arange(300), back + 0.005 + 0.01 * np.arange(100)])
    path = recorded(tmp_path / "back.mcap", stamps.tolist())
    with pytest.warns(DistalWarning, match=r"set back 1 times; only part 1 of 2 is read"):
        np.testing.assert_allclose(read_log(path, rig).time, stamps[:300])


def stamped(**topics: list[tuple[int, int, int, float]]) -> dict[str, Stamped]:
    """Return stamps and values by topic, of messages (order, stamp, recorded, value)."""
    readings = {f"/{topic}.x": messages for topic, messages in topics.items()}
    return _stamped(Path("run.mcap"), readings)  # type: ignore[arg-type]


@pytest.mark.parametrize("k", [0, 1, 77, 199])
@pytest.mark.parametrize("stamp", [12.5, 1.8e9, 2.1e9])
def test_a_wild_stamp_costs_its_message_only(k: int, stamp: float) -> None:
    rows = range(200)
    times = [1_700_000_000 * 10**9 + row * 10**7 for row in rows]
    good = [(2 * row, time, time, 1.0) for row, time in zip(rows, times)]
    odd = [(2 * row + 1, time, time, float(row)) for row, time in zip(rows, times)]
    odd[k] = (2 * k + 1, round(stamp * 1e9), times[k], -1.0)
    with pytest.warns(DistalWarning, match=f"message {k + 1} of /odd left out") as said:
        found = stamped(good=good, odd=odd)
    assert len(said) == 1
    np.testing.assert_array_equal(found["/good.x"][0], times)
    np.testing.assert_array_equal(found["/odd.x"], np.delete([times, rows], k, axis=1))


def test_where_a_clock_was_set_back_all_topics_are_cut() -> None:
    """At its messages, whatever the recorder's clock and those of the others do."""
    seconds = (1, 2, 3, 4, 5, 1, 2, 3)
    back, too, never = (
        [(2 * i + odd, k * 10**9, k * 10**9, 1.0) for i, k in enumerate(at)]
        for odd, at in ((0, seconds), (1, seconds), (1, range(1, 9)))
    )
    for other, left in ((too, 4), (never, 4), ([too[1], too[6]], 1)):
        with pytest.warns(DistalWarning, match="set back 1 times; only part 1 of 2 is read"):
            parts = stamped(a=back, b=other)
        assert [len(stamps) for stamps, _ in parts.values()] == [5, left]


def test_a_recorder_without_a_clock_tells_no_clocks_apart() -> None:
    """Who converts logs may write one time of recording for all messages."""
    first = [(2 * k, k * 10**7, 0, 1.0) for k in range(100)]
    second = [(2 * k + 1, k * 10**7 + 4 * 10**6, 0, 2.0) for k in range(100)]
    assert list(stamped(a=first, b=second)) == ["/a.x", "/b.x"]


def test_odd_messages_are_one_line(rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "odd.mcap"
    for stamp, said in (
        ("abc", "'t' is 'abc'"),
        (1.7e12, "is no time; what unit"),
        ({"sec": 1}, "a number is expected"),
    ):
        with pytest.raises(LogError, match=said):
            read_log(recorded(path, [0.0, 0.01, stamp]), rig)
    text = read_log(recorded(path, [0.0, 0.01, 0.02], x1="0.001"), rig)
    np.testing.assert_allclose(text.channels["x1"], 1e-3, rtol=0.01)


def test_columns_named_by_topic_are_found_in_json(named: Rig, tmp_path: Path) -> None:
    """Of messages whose members are columns of a rig of ROS, and of nested objects."""
    path = recorded(tmp_path / "run.mcap", [0.0, 0.01], **dict.fromkeys(TOPICS.values(), 3.0))
    np.testing.assert_array_equal(read_log(path, named).channels["u1"], [3.0, 3.0])
    for message in (
        {"/left": {"position": [3.0]}},
        {"left": {"position": [3.0]}},
        {"/left.position[0]": 3.0},
    ):
        assert find(message, "/left.position[0]") == 3.0
    for odd in (
        "/left.position[0]",
        "a[²]",
        "a[١]",
        "a[99999999999999999999]",
        "a[-1]",
        "a" + ".a" * 5000,
    ):
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
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("mcap.reader", "rosbags.highlevel"):
        monkeypatch.setitem(sys.modules, module, None)
    for name, extra in (("run.mcap", "mcap"), ("run.db3", "ros")):
        (tmp_path / name).touch()
        with pytest.raises(LogError, match=rf"pip install '\.\[{extra}\]'"):
            open_table(tmp_path / name, ["/a.x"])


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
    """The rig with columns by topic, name of a joint, and field."""
    columns = {
        f"{kind}{number}": f"/joint_states[{side}.motor].{field}"
        for number, side in ((1, "left"), (2, "right"))
        for kind, field in (("x", "position"), ("u", "effort"))
    }
    return with_columns(rig, columns)


@pytest.mark.parametrize("apart", [0.0, 0.003])
def test_joints_by_their_names(by_name: Rig, log: Log, tmp_path: Path, apart: float) -> None:
    """Wherever they stand in a message, and also where each has a message of its own; the original
    stamps are kept.
    """
    read = read_log(joints_bag(log, tmp_path / "run", apart), by_name)
    check(read, log)
    assert read.stamps is not None
    np.testing.assert_allclose((read.stamps - 1.7e18) * 1e-9, log.time, atol=1e-6)


@pytest.mark.parametrize(("side", "lost"), [("right", ("x2", "u2")), ("left", ("x1", "u1"))])
def test_a_joint_whose_message_is_lost_costs_its_own_value_only(
    by_name: Rig, log: Log, tmp_path: Path, side: str, lost: tuple[str, str]
) -> None:
    """The next message of the lost joint, an interval later, is not taken for the one that is
    missing.
    """
    read = read_log(joints_bag(log, tmp_path / "run", 0.003, lost=(50, side)), by_name)
    check(read, log, **dict.fromkeys(lost, 50))


def test_odd_json_that_nobody_asked_for(tmp_path: Path) -> None:
    """Whatever its shape, it hides no column of the others."""
    recorder = Recorder(tmp_path / "run.mcap")
    for odd in (
        {"m": [[1, 2], [3]]},
        {"name": [1, None, ["x"]], "position": [0.5]},
        {"name": ["a", "b"], "pos[left]": 1.0},
        {"m": [{"n": 1}, 2]},
    ):
        recorder.add(SAMPLE_TOPIC, 0.1, {"t": 0.1, "x1": 1.0})
        recorder.add("robot/estimate", 0.1, odd)
    recorder.close()
    assert f"{SAMPLE_TOPIC}.x1" in recorded_columns(tmp_path / "run.mcap")

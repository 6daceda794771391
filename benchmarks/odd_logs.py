"""Odd files as people's loggers write them, and what the commands make of them:
`python -m benchmarks.odd_logs [--kind WORDS] [--keep FOLDER] [--jobs N]`.

Each case is a simulated log of a hand of two motors (in `DISTAL_DATA`/cases/base) that is written
the way a public report describes. A command is right if it reads the file as it is meant: it ends
well and its angles are as good as those of the clean log. Else it must name the cause.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.report import table

Floats = NDArray[np.float64]
Command = list[str]

BASE = Path(os.environ.get("DISTAL_DATA", "")) / "cases" / "base"

WORSE, MORE = 1.5, 0.2
"""Angles are right within so many times the RMS error on the clean log, and so much more [deg]."""

LIMIT, FIRST_WORDS = 60.0, 40.0
"""How long a command may take, and how long a fit is listened to [s]."""

MOTORS = ["pos_1", "cur_1", "pos_2", "cur_2"]
JOINTS = ["encoder_index_mcp", "encoder_index_pip"]
SENSORS = {
    "pos_1": "motor_1_position",
    "cur_1": "motor_1_current",
    "pos_2": "motor_2_position",
    "cur_2": "motor_2_current",
    "encoder_index_mcp": "encoder_index_mcp",
    "encoder_index_pip": "encoder_index_pip",
}
"""Column of the base logs → sensor of the base rig."""

PER_COUNT = 360 / 4096
"""Angle of one count [deg]."""

NO_SIGN = (
    r"\bno sign\b|without (a |its )?sign|never (negative|below)|magnitude|absolute"
    r"|unsigned"
)
DEAD = (
    r"one value|constant|never changes|does not change|throughout|whole log|always"
    r"|\bstuck\b|\bdead\b"
)
CLOCK = r"clock|time of day|HH:MM|AM/PM|\b12-hour|month|ISO text|forms? of time"
COARSE = (
    r"share (a|one|the same) (stamp|time)"
    r"|(rows|samples|readings) (per|a|for each|of one|with one) (stamp|second)"
    r"|round(ed)?\b|digits|coarse|cut (to|off)|whole seconds|one (stamp|time)\b"
    r"|same (stamp|time)|time repeats"
)
UNITS = r"row 2\b.*\bunits?\b|\b(row|line) of units|units? .{0,40}\b(row|line) 2"
HEADER = r"repeats? (of )?the header|header (again|repeat)|header.{0,20} repeated"
HASH = r"#|comment|metadata|separated by (blanks|spaces|tabs)|before the header"
LISTS = r"\blists?\b|\bbag\b|arrays?\b|several numbers|tuples?\b"
NO_TIME = (
    r"\bHz\b|fixed rate|--[a-z-]*rate|sampling rate|time column"
    r"|\b(one|each|single) (episode|demo)"
)
SIGN_BIT = r"bit \d+|sign bit|sign.magnitude"
WRAP16 = r"unsigned|65,?536|16.bit"
NO_LENGTHS = r"sums? (of )?(the )?(joint )?angles|not? (a )?lengths?|radius|\bcoef"
EFFORT = r"effort|missing"
TWICE = r"publishers?|twice|two messages|same stamp|zeros"
NAMES = r"order of (the )?names|names? change"
MIRROR = (
    r"mirror|\bflip|changes? (its )?sign|other sign|outliers?"
    r"|\b(encoder|reference)\w*\b.{0,80}\b(jumps?|left out|implausible)"
)
WRAPS = r"wraps?\b|wrapped|\b360\b|jumps?\b|whole turn|unwrapped|±180"

NOT = re.compile(r"\b(not|no|cannot|never|nothing|untested|neither)\b")


@dataclass(frozen=True)
class Case:
    """An odd log, or some of them, and what a command has to make of it.

    Args:
        name: what is odd.
        kind: what kind of oddness it is.
        command: estimate, rig from-logs, fit, learn or rig from-mjcf.
        odd: names of the files that the command reads; `write` makes them in a folder.
        frames: the same logs as they were measured, with the truth; the estimate is of the first.
        words: pattern of which a message has something that names the cause.
        rig: the rig for the odd log.
        clean_rig: the rig for the clean logs, with the columns of the base.
        refs: whether the odd logs have references.
        dead: columns of the base that tell nothing; a clean log may lack them.
        others: other truths that are right as well, e.g. of another part of the log.
        width: by how much the stamps of rows may be off [s].
    """

    name: str
    kind: str
    command: str
    odd: list[str]
    write: Callable[[Path], None]
    frames: list[pd.DataFrame]
    words: str
    rig: str = ""
    clean_rig: str = ""
    refs: bool = False
    dead: tuple[str, ...] = ()
    others: list[pd.DataFrame] = field(default_factory=list)
    width: float = 0.0

    @property
    def limit(self) -> float:
        """How long each of its commands may take [s]."""
        return FIRST_WORDS if self.command in ("fit", "learn") else LIMIT

    def commands(self) -> list[Command]:
        """Return what is run for the odd log."""
        paths = [f"{{folder}}/{name}" for name in self.odd]
        return chain(self.command, paths, "{folder}/hand.toml", "{folder}/odd")


@dataclass(frozen=True)
class Ran:
    """What came of one command."""

    code: int
    out: str
    err: str

    @property
    def text(self) -> str:
        """All that it said, each message in one line."""
        return re.sub(r"[ \t]+", " ", f"{self.out}\n{self.err}")


@dataclass(frozen=True)
class Judged:
    """Whether a case is right, named or wrong, and why."""

    case: Case
    verdict: str
    why: str = ""
    last: str = ""


def chain(command: str, logs: list[str], rig: str, stem: str) -> list[Command]:
    """Return the commands from logs to an estimate of the first of them."""
    out = f"{stem}_estimate.csv"
    made = f"{stem}_rig.toml"
    if command == "estimate":
        return [["estimate", *logs, "--rig", rig, "--out", out]]
    if command == "rig from-logs":
        first = ["rig", "from-logs", *logs, "--out", made]
        return [first, ["estimate", logs[0], "--rig", made, "--out", out]]
    if command == "fit":
        first = ["fit", *logs, "--rig", rig, "--out", made]
        return [first, ["estimate", "{folder}/clean_0.csv", "--rig", made, "--out", out]]
    if command == "learn":
        first = ["learn", *logs, "--out", made]
        return [first, ["estimate", "{folder}/clean_0.csv", "--rig", made, "--out", out]]
    return [["rig", "from-mjcf", *logs, "--out", made]]


def run(command: Command, folder: Path, limit: float) -> Ran:
    """Run one command of distal; it is ended after `limit` seconds, with code 124."""
    args = [part.replace("{folder}", str(folder)) for part in command]
    program = Path(sys.executable).parent / "distal"
    environment = os.environ | {"COLUMNS": "500", "PYTHONUNBUFFERED": "1", "NO_COLOR": "1"}
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = subprocess.Popen(
            [str(program), *args],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            env=environment,
            cwd=folder,
            start_new_session=True,
        )
        try:
            code = process.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            code = 124
        out.seek(0)
        err.seek(0)
        return Ran(code, out.read(), err.read())


def run_all(commands: Sequence[Command], folder: Path, limit: float) -> list[Ran]:
    """Run commands until one fails."""
    for path in folder.glob("odd_*"):
        path.unlink()
    results = list[Ran]()
    for command in commands:
        results.append(run(command, folder, limit))
        if results[-1].code:
            break
    return results


def angles_of(path: Path) -> tuple[Floats, Floats]:
    """Return time [s] and angles of both joints [deg], (n, 2), of an estimate."""
    frame = pd.read_csv(path)
    names = [c for c in frame if c.startswith("theta_") and "_std" not in c]
    names.sort(key=lambda c: "pip" in c)  # others stay in their order
    columns = list[Floats]()
    for name in names:
        values = frame[name].to_numpy(float)
        columns.append(values if "[deg]" in name else np.rad2deg(values))
    return frame.iloc[:, 0].to_numpy(float), np.column_stack(columns)


def rms(path: Path, truth: pd.DataFrame, width: float) -> Floats:
    """Return the RMS errors of an estimate [deg], (2,): by rows where it has as many as the truth
    and lasts as long, else by its time.
    """
    time, angles = angles_of(path)
    true_time = truth["time"].to_numpy(float) - truth["time"].iloc[0]
    true_angles = truth[JOINTS].to_numpy(float)
    if angles.shape[1] != 2 or len(time) < 2:
        return np.full(2, np.inf)
    span, length = time[-1] - time[0], true_time[-1]
    if abs(span - length) > 0.05 * length + 2 * width:
        return np.full(2, np.inf)
    if len(time) == len(true_time):
        return np.asarray(np.sqrt(np.mean((angles - true_angles) ** 2, axis=0)))
    found = list[Floats]()
    for off in np.linspace(-width, width, 21 if width else 1):
        at = time - time[0] + off
        wanted = np.column_stack([np.interp(at, true_time, one) for one in true_angles.T])
        found.append(np.sqrt(np.mean((angles - wanted) ** 2, axis=0)))
    return min(found, key=lambda one: float(one.sum()))


def tendons_of(path: Path) -> int:
    """Return how many tendons a rig file has, 0 where there is none."""
    return path.read_text(encoding="utf-8").count("[[tendons]]") if path.exists() else 0


def clean_limits(case: Case, folder: Path) -> tuple[Floats, set[int]]:
    """Return the largest RMS errors that are right [deg], (2,), and how many tendons a rig that was
    made may have, by the clean logs.
    """
    worst, tendons = np.zeros(2), set[int]()
    for lacking in [(), case.dead] if case.dead else [()]:
        rig = without(case.clean_rig, lacking)
        (folder / "clean.toml").write_text(rig, encoding="utf-8")
        for k, frame in enumerate(case.frames):
            kept = frame.drop(columns=[*lacking, *([] if case.refs else JOINTS)])
            kept.to_csv(folder / f"clean_{k}.csv", index=False)
        logs = [f"{{folder}}/clean_{k}.csv" for k in range(len(case.frames))]
        command = "estimate" if case.command == "learn" else case.command
        if command == "estimate":
            logs = logs[:1]
        commands = chain(command, logs, "{folder}/clean.toml", "{folder}/clean")
        results = [run(one, folder, 2 * LIMIT) for one in commands]
        path = folder / "clean_estimate.csv"
        if path.exists():
            worst = np.maximum(worst, rms(path, case.frames[0], 0.0))
            path.unlink()
        else:
            raise RuntimeError(f"the clean log is not read: {results[-1].err.strip()[-200:]}")
        tendons.add(tendons_of(folder / "clean_rig.toml"))
    return WORSE * worst + MORE, tendons


def claims(case: Case, text: str) -> str:
    """Return a clause in which a dead column is said to agree with the rig, or nothing."""
    if case.words is NO_SIGN:
        return ""  # such a current may agree where a drive pulls one way only
    names = [*case.dead, *(SENSORS[column] for column in case.dead)]
    names += [f"m{column[-1]}_force" for column in case.dead]  # in a rig from logs
    for clause in re.split(r";\s|\n|\.\s", text):
        is_named = any(name in clause for name in names)
        if is_named and re.search(r"\bagrees?\b", clause) and not NOT.search(clause):
            return clause.strip()
    return ""


def fault_of(case: Case, ran: Sequence[Ran], count: int, folder: Path) -> str:
    """Return why commands did not read the log right; nothing where they did."""
    if ran[-1].code or len(ran) < count:
        return f"ended with {ran[-1].code}"
    path = folder / "odd_estimate.csv"
    if not path.exists():
        return "no estimate"
    claimed = claims(case, "\n".join(one.text for one in ran))
    if claimed:
        return f"says: {claimed[:120]}"
    limits, tendons = clean_limits(case, folder)
    found = tendons_of(folder / "odd_rig.toml")
    if case.command == "rig from-logs" and found not in tendons:
        return f"{found} tendons where {sorted(tendons)} are right"
    errors = [rms(path, truth, case.width) for truth in (case.frames[0], *case.others)]
    if any(bool((one <= limits).all()) for one in errors):
        return ""
    best = min(errors, key=lambda one: float(one.sum()))
    return f"{best[0]:.2f}°, {best[1]:.2f}° RMS where {limits[0]:.2f}°, {limits[1]:.2f}° are right"


def judge(case: Case, folder: Path) -> Judged:
    """Return what came of a case."""
    folder.mkdir(parents=True, exist_ok=True)
    if case.rig:
        (folder / "hand.toml").write_text(case.rig, encoding="utf-8")
    case.write(folder)
    for k, frame in enumerate(case.frames):
        frame.to_csv(folder / f"clean_{k}.csv", index=False)
    commands = case.commands()
    ran = run_all(commands, folder, case.limit)
    text = "\n".join(one.text for one in ran)
    last = "\n".join(ran[-1].err.strip().splitlines()[-2:])
    for place in (str(folder), *case.odd):  # names of files are no words of a message
        text = text.replace(place, "")
    (folder / "said.txt").write_text(text, encoding="utf-8")
    named = re.search(case.words, text, re.IGNORECASE) is not None
    if case.command == "rig from-mjcf":
        named = named and "--length-unit" not in text
        return Judged(case, "named" if named else "wrong", f"ended with {ran[-1].code}", last)
    why = fault_of(case, ran, len(commands), folder)
    if not why:
        return Judged(case, "right")
    named = named and not claims(case, text)
    return Judged(case, "named" if named else "wrong", why, last)


# logs and rigs ------------------------------------------------------------------------------------


def base(k: int, begin: int = 0, end: int = 2000, step: int = 1) -> pd.DataFrame:
    """Return some rows of a base log."""
    frame = pd.read_csv(BASE / f"log_{k}.csv").iloc[begin:end:step].reset_index(drop=True)
    frame["time"] = (frame["time"] - frame["time"].iloc[0]).round(4)
    return frame.round(6)


def hand(
    columns: Mapping[str, str] | None = None,
    shift: tuple[int, int] = (0, 0),
    time: str = "time",
    si: bool = False,
    turned: float = 0.0,
) -> str:
    """Return the text of the base rig.

    Args:
        columns: column of the base → column of the log.
        shift: counts by which both positions are less than in the base.
        si: whether positions are in rad and efforts in N m.
        turned: by how much the angle of the first joint is larger [deg].
    """
    text = (BASE / "hand.toml").read_text(encoding="utf-8")
    text = text.replace('time = {column = "time"', f'time = {{column = "{time}"')
    first = 5 - shift[0] * PER_COUNT - 8 / 7 * turned
    second = -5 + shift[1] * PER_COUNT
    text = text.replace('bias = {value = "5 deg"', f'bias = {{value = "{first:.6f} deg"')
    text = text.replace('bias = {value = "-5 deg"', f'bias = {{value = "{second:.6f} deg"')
    text = text.replace(
        'stops = ["-20 deg", "95 deg"]', f'stops = ["{turned - 20} deg", "{turned + 95} deg"]'
    )
    text = text.replace('value = "37.5 deg"', f'value = "{turned + 37.5} deg"')
    if si:
        text = text.replace('unit = "count"\ncounts_per_turn = 4096.0', 'unit = "rad"')
        text = text.replace('unit = "mA"\ntorque_constant = 1.2', 'unit = "N m"')
        text = text.replace('noise = "6 mA"', 'noise = "7.2 mN m"')
    parts = text.split("\n\n")
    for k, part in enumerate(parts):
        for column, name in (columns or {}).items():
            if f'name = "{SENSORS[column]}"' in part:
                kept = re.sub(r'\ncolumn = ".*"', "", part.rstrip("\n"))
                parts[k] = f'{kept}\ncolumn = "{name}"'
    return "\n\n".join(parts) + "\n"


def without(rig: str, columns: Sequence[str]) -> str:
    """Return a rig without the sensors of some columns of the base."""
    names = [f'name = "{SENSORS[column]}"' for column in columns]
    return "\n\n".join(p for p in rig.split("\n\n") if not any(name in p for name in names))


def cells(frame: pd.DataFrame) -> list[list[str]]:
    """Return the rows of a log as text."""
    forms = {"time": "{:.4f}", "pos_1": "{:.0f}", "pos_2": "{:.0f}"}
    columns = [[forms.get(c, "{:.1f}").format(v) for v in frame[c]] for c in frame]
    return [list(row) for row in zip(*columns)]


def texts(
    name: str,
    frames: Sequence[pd.DataFrame],
    change: Callable[[pd.DataFrame], list[list[str]]],
    separator: str = ",",
) -> tuple[list[str], Callable[[Path], None]]:
    """Return names of text files, one for each log, and what writes them."""
    names = [f"{name}_{k}.csv" for k in range(len(frames))]

    def write(folder: Path) -> None:
        for file, frame in zip(names, frames):
            lines = [separator.join(row) for row in change(frame)]
            (folder / file).write_text("\n".join(lines) + "\n", encoding="utf-8")

    return names, write


def of_text(
    name: str,
    kind: str,
    command: str,
    frames: list[pd.DataFrame],
    change: Callable[[pd.DataFrame], list[list[str]]],
    words: str,
    separator: str = ",",
    **more: Any,
) -> Case:
    """Return a case of text files."""
    refs = command in ("rig from-logs", "fit", "learn")
    shown = frames if refs else [frame.drop(columns=JOINTS) for frame in frames]
    names, write = texts("log", shown, change, separator)
    settings: dict[str, Any] = {"rig": hand(), "clean_rig": hand(), "refs": refs} | more
    return Case(name, kind, command, names, write, frames, words, **settings)


def changed(
    change: Callable[[pd.DataFrame], pd.DataFrame],
) -> Callable[[pd.DataFrame], list[list[str]]]:
    """Return rows of a log with its header after a change of its numbers."""

    def rows(frame: pd.DataFrame) -> list[list[str]]:
        new = change(frame.copy())
        return [[str(c) for c in new], *cells(new)]

    return rows


def stamped(
    form: Callable[[datetime], str], start: datetime, name: str = "time"
) -> Callable[[pd.DataFrame], list[list[str]]]:
    """Return rows of a log whose time is a clock's."""

    def rows(frame: pd.DataFrame) -> list[list[str]]:
        times = [start + timedelta(seconds=float(t)) for t in frame["time"]]
        header = [name, *(str(c) for c in frame.columns[1:])]
        return [header, *([form(t), *row[1:]] for t, row in zip(times, cells(frame)))]

    return rows


# cases --------------------------------------------------------------------------------------------


def currents() -> list[Case]:
    """Currents without a sign, and those that never change."""

    def size(*columns: str) -> Callable[[pd.DataFrame], list[list[str]]]:
        return changed(lambda frame: frame.assign(**{c: frame[c].abs() for c in columns}))

    def held(**values: float) -> Callable[[pd.DataFrame], list[list[str]]]:
        return changed(lambda frame: frame.assign(**values))

    def tiny(frame: pd.DataFrame) -> list[list[str]]:
        rows = [[str(c) for c in frame], *cells(frame)]
        at = [rows[0].index("cur_1"), rows[0].index("cur_2")]
        for row in rows[1:]:
            for k in at:
                row[k] = "6.95e-310"
        return rows

    kind, both = "current without a sign", ("cur_1", "cur_2")
    found = [
        of_text(
            "both",
            kind,
            "estimate",
            [base(2, 100)],
            size(*both),
            NO_SIGN,
            dead=both,
        ),
        of_text(
            "one of two",
            kind,
            "estimate",
            [base(0)],
            size("cur_2"),
            NO_SIGN,
            dead=("cur_2",),
        ),
        of_text(
            "from logs",
            kind,
            "rig from-logs",
            [base(0), base(3)],
            size(*both),
            NO_SIGN,
            dead=both,
        ),
    ]
    kind = "current that never changes"
    found += [
        of_text("zeros", kind, "estimate", [base(3)], held(cur_1=0.0, cur_2=0.0), DEAD, dead=both),
        of_text(
            "one, not zero",
            kind,
            "estimate",
            [base(2, 0, 1500)],
            held(cur_1=2.7),
            DEAD,
            dead=("cur_1",),
        ),
        of_text(
            "far from zero",
            kind,
            "estimate",
            [base(0, 0, 1800)],
            held(cur_2=-31.0),
            DEAD,
            dead=("cur_2",),
        ),
        of_text("denormal", kind, "estimate", [base(0)], tiny, DEAD, dead=both),
        of_text(
            "from logs",
            kind,
            "rig from-logs",
            [base(2), base(3)],
            held(cur_1=0.0, cur_2=0.0),
            DEAD,
            dead=both,
        ),
    ]
    return found


def twelve(t: datetime) -> str:
    """Return a time of day of 12 hours, without leading zeros."""
    return f"{(t.hour - 1) % 12 + 1}:{t:%M:%S}.{t.microsecond // 1000:03d} {t:%p}"


def millis(t: datetime, point: str = ".") -> str:
    """Return a time of day with thousandths."""
    return f"{t:%H:%M:%S}{point}{t.microsecond // 1000:03d}"


def clocks() -> list[Case]:
    """Times as clocks show them."""
    noon, night = datetime(2026, 3, 4, 11, 59, 52), datetime(2026, 3, 4, 23, 59, 51)
    forms: list[tuple[str, Callable[[datetime], str], datetime, str]] = [
        ("thousandths, over midnight", millis, night, ","),
        ("comma, between semicolons", lambda t: millis(t, ","), noon, ";"),
        ("comma, quoted", lambda t: f'"{millis(t, ",")}"', night, ","),
        ("12 hours, over noon", twelve, noon, ","),
        ("12 hours, over midnight", twelve, night, ","),
        ("12 hours, twelve to one", twelve, datetime(2026, 3, 4, 12, 59, 55), ","),
        ("US date", lambda t: f"{t:%m/%d/%Y} {millis(t)}", datetime(2026, 10, 25, 9), ","),
        ("US date, 12 hours", lambda t: f"{t:%m/%d/%Y} {twelve(t)}", night, ","),
        ("US date, either order", lambda t: f"{t.month}/{t.day}/{t.year} {millis(t)}", night, ","),
        ("zone", lambda t: f"{t:%Y-%m-%d} {millis(t)}+02:00", night, ","),
        ("zone without a colon", lambda t: f"{t:%Y-%m-%dT%H:%M:%S.%f}-0700", noon, ","),
        ("no zone, comma", lambda t: f'"{t:%Y-%m-%d} {millis(t, ",")}"', noon, ","),
    ]
    found = list[Case]()
    for k, (name, form, start, separator) in enumerate(forms):
        rows = stamped(form, start)
        log = base(k % 4, 0, 1600)
        found.append(of_text(name, "clock time", "estimate", [log], rows, CLOCK, separator))
    rows = stamped(millis, night)
    pair = [base(1), base(2)]
    found.append(of_text("from logs", "clock time", "rig from-logs", pair, rows, CLOCK))
    return found


def rounded() -> list[Case]:
    """Times with few digits."""
    start = 1_760_000_431.0

    def printed(form: Callable[[float], str]) -> Callable[[pd.DataFrame], list[list[str]]]:
        def rows(frame: pd.DataFrame) -> list[list[str]]:
            header = [str(c) for c in frame]
            body = zip(frame["time"], cells(frame))
            return [header, *([form(float(t)), *row[1:]] for t, row in body)]

        return rows

    def second(t: datetime) -> str:
        return f"{t:%Y-%m-%d %H:%M:%S}"

    forms: list[tuple[str, Callable[[float], str], float]] = [
        ("six digits of a date", lambda t: f"{start + t:.6g}", 1e9),
        ("six digits, ms", lambda t: f"{1000 * (start + t):.6g}", 1e9),
        ("six digits of an uptime", lambda t: f"{184302.36 + t:.6g}", 1.0),
        ("tenths", lambda t: f"{start + 0.03 + t:.1f}", 0.1),
        ("tenths from zero", lambda t: f"{t:.1f}", 0.1),
        ("whole seconds", lambda t: f"{int(start + 0.37 + t)}", 1.0),
    ]
    found = list[Case]()
    for k, (name, form, width) in enumerate(forms):
        log = base(k % 4, 0, 1700)
        rows = printed(form)
        found.append(of_text(name, "coarse time", "estimate", [log], rows, COARSE, width=width))
    at = datetime(2026, 10, 25, 14, 3, 7, 420000)
    rows = stamped(second, at)
    for name, log in (("date of whole seconds", base(3)), ("the same, 50 Hz", base(0, step=2))):
        found.append(of_text(name, "coarse time", "estimate", [log], rows, COARSE, width=1.0))
    return found


def headers() -> list[Case]:
    """Rows of units, headers in the middle, and comments before them."""

    def under(*units: str) -> Callable[[pd.DataFrame], list[list[str]]]:
        def rows(frame: pd.DataFrame) -> list[list[str]]:
            return [[str(c) for c in frame], list(units[: frame.shape[1]]), *cells(frame)]

        return rows

    def other(frame: pd.DataFrame) -> list[list[str]]:
        new = frame.assign(time=1000 * frame["time"])
        new["cur_1"] = frame["cur_1"] / 1000
        new["cur_2"] = frame["cur_2"] / 1000
        new["pos_1"] = frame["pos_1"] * PER_COUNT
        new["pos_2"] = frame["pos_2"] * PER_COUNT
        body = [[f"{v:.6g}" for v in row] for row in new.to_numpy(float)]
        return [[str(c) for c in new], ["[ms]", "[deg]", "[A]", "[deg]", "[A]"], *body]

    kind = "row of units"
    five = ("[s]", "[count]", "[mA]", "[count]", "[mA]")
    round_ones = ("(sec)", "(ticks)", "(mA)", "(ticks)", "(mA)", "(deg)", "(deg)")
    words = ("seconds", "counts", "milliamps", "counts", "milliamps", "degrees", "degrees")
    some = ("s", "", "mA", "", "mA")
    found = [
        of_text("brackets", kind, "estimate", [base(0)], under(*five), UNITS),
        of_text("round brackets", kind, "estimate", [base(2)], under(*round_ones), UNITS, "\t"),
        of_text("words", kind, "estimate", [base(3)], under(*words), UNITS, ";"),
        of_text("some empty", kind, "estimate", [base(1)], under(*some), UNITS),
        of_text("other units than the rig's", kind, "estimate", [base(0)], other, UNITS),
        of_text(
            "from logs",
            kind,
            "rig from-logs",
            [base(0), base(3)],
            under(*round_ones),
            UNITS,
        ),
    ]
    return [*found, *repeated_headers(), *comments()]


def repeated_headers() -> list[Case]:
    """Headers that are there again."""

    def every(count: int, header: Callable[[str], str] = str) -> Callable[[Any], list[list[str]]]:
        def rows(frame: pd.DataFrame) -> list[list[str]]:
            names = [str(c) for c in frame]
            again = [header(name) for name in names]
            found = [names]
            for k, row in enumerate(cells(frame)):
                if k and k % count == 0:
                    found.append(again)
                found.append(row)
            return found

        return rows

    def at(*places: int) -> Callable[[pd.DataFrame], list[list[str]]]:
        def rows(frame: pd.DataFrame) -> list[list[str]]:
            found = [[str(c) for c in frame], *cells(frame)]
            for place in reversed(places):
                found.insert(1 + place, found[0])
            return found

        return rows

    kind = "header again"
    first, second = base(2, 0, 1300), base(3, 1300)
    second["time"] += 13.0
    joined = pd.concat([first, second], ignore_index=True)
    whole, part = base(1, 0, 1400), base(2, 0, 600)
    restarted = pd.concat([whole, part], ignore_index=True)
    in_row = restarted.assign(time=0.01 * np.arange(len(restarted)))
    twice = of_text("clock restarts", kind, "estimate", [restarted], at(1400), HEADER)
    twice = replace(twice, frames=[whole], others=[in_row])
    return [
        of_text("every 400 rows", kind, "estimate", [base(0)], every(400), HEADER),
        of_text("with blanks", kind, "estimate", [base(3)], every(700, lambda n: f" {n}"), HEADER),
        of_text("files joined", kind, "estimate", [joined], at(1300), HEADER, ";"),
        of_text("in row 2 and last", kind, "estimate", [base(1)], at(0, 1999, 2000), HEADER),
        twice,
        of_text("from logs", kind, "rig from-logs", [base(1), base(0)], every(900), HEADER),
    ]


def comments() -> list[Case]:
    """Lines before the header."""
    kind = "comments before the header"

    def after(*before: str, mark: str = "") -> Callable[[pd.DataFrame], list[list[str]]]:
        def rows(frame: pd.DataFrame) -> list[list[str]]:
            header = [str(c) for c in frame]
            header[0] = mark + header[0]
            return [*([line] for line in before), header, *cells(frame)]

        return rows

    def padded(frame: pd.DataFrame) -> list[list[str]]:
        rows = [["# time", *(str(c) for c in frame.columns[1:])], *cells(frame)]
        return [[cell.rjust(10) if k else cell for k, cell in enumerate(row)] for row in rows]

    meta = ("# robot: left hand", "# rate: 100 Hz, filter = off", "# started 2026-10-25T14:03:07")
    plain = ("Logger 2.1", "Device: hand, left", "")
    pair = [base(0), base(2)]

    def case(
        name: str, k: int, change: Callable[[pd.DataFrame], list[list[str]]], separator: str
    ) -> Case:
        return of_text(name, kind, "estimate", [base(k)], change, HASH, separator)

    return [
        case("tabs, # before the names", 1, after(mark="# "), "\t"),
        case("blanks, # before the names", 2, after(mark="#"), " "),
        case("aligned by blanks", 3, padded, " "),
        case("metadata, names marked as well", 0, after(*meta, mark="# "), ","),
        case("metadata, names plain", 2, after(*meta), ","),
        case("metadata, tabs", 3, after(*meta[:2], mark="#"), "\t"),
        case("metadata without a mark", 1, after(*plain), ","),
        of_text("from logs, tabs", kind, "rig from-logs", pair, after(mark="#"), HASH, "\t"),
        of_text("from logs, metadata", kind, "rig from-logs", pair, after(*meta), HASH),
    ]


def in_si(frame: pd.DataFrame) -> pd.DataFrame:
    """Return positions in rad, efforts in N m and angles in rad."""
    new = frame.copy()
    new[["pos_1", "pos_2"]] = frame[["pos_1", "pos_2"]] * np.deg2rad(PER_COUNT)
    new[["cur_1", "cur_2"]] = frame[["cur_1", "cur_2"]] * 1.2e-3
    new[JOINTS] = np.deg2rad(frame[JOINTS])
    return new


def lists() -> list[Case]:
    """Lists in cells, as tools write messages of a bag."""
    kind = "lists in cells"

    def written(
        form: Callable[[Sequence[float]], str], angles: bool
    ) -> Callable[[Any], list[list[str]]]:
        def rows(frame: pd.DataFrame) -> list[list[str]]:
            new = in_si(frame)
            header = ["Time", "name", "position", "velocity", "effort"]
            header += ["index_mcp_angle", "index_pip_angle"] if not angles else ["joint_angles"]
            found = [header]
            for row in new.to_dict("records"):
                position = form([row["pos_1"], row["pos_2"]])
                effort = form([row["cur_1"], row["cur_2"]])
                truth = [f"{row[name]:.6f}" for name in JOINTS]
                last = [form([row[name] for name in JOINTS])] if angles else truth
                stamp = f"{1_760_000_000 + row['time']:.3f}"
                names = "\"['motor_1', 'motor_2']\""
                found.append([stamp, names, position, form([]), effort, *last])
            return found

        return rows

    def listed(values: Sequence[float]) -> str:
        return f'"[{", ".join(f"{v:.9f}" for v in values)}]"'

    def tuples(values: Sequence[float]) -> str:
        return f'"({", ".join(f"{v:.9f}" for v in values)})"'

    def numpy_like(values: Sequence[float]) -> str:
        return f"[{'  '.join(f'{v: .8f}' for v in values)}]"

    def arrays(values: Sequence[float]) -> str:
        return f"\"array('d', [{', '.join(f'{v:.9f}' for v in values)}])\""

    pair = [base(0), base(1)]
    forms = (("brackets", listed), ("round", tuples), ("numpy", numpy_like), ("array", arrays))
    found = list[Case]()
    for name, form in forms:
        for angles in (False, True) if name in ("brackets", "numpy") else (False,):
            title = f"{name}, angles too" if angles else name
            found.append(of_text(title, kind, "rig from-logs", pair, written(form, angles), LISTS))
    return found


def episodes() -> list[Case]:
    """HDF5 files without a column of time."""
    kind = "HDF5 without time"
    logs = [base(2, step=2), base(3, step=2)]

    def aloha(path: Path, frame: pd.DataFrame) -> None:
        import h5py

        new = in_si(frame)
        with h5py.File(path, "w") as file:
            file.attrs["sim"] = False
            file["observations/qpos"] = new[["pos_1", "pos_2"]].to_numpy()
            file["observations/effort"] = new[["cur_1", "cur_2"]].to_numpy()
            file["observations/joint_angle"] = new[JOINTS].to_numpy()
            file["observations/images/cam_high"] = np.zeros((len(new), 4, 6, 3), np.uint8)
            file["action"] = np.roll(new[["pos_1", "pos_2"]].to_numpy(), -1, axis=0)

    def robomimic(path: Path, frames: Sequence[pd.DataFrame]) -> None:
        import h5py

        with h5py.File(path, "w") as file:
            file.create_group("data").attrs["total"] = sum(len(one) for one in frames)
            for k, frame in enumerate(frames):
                new = in_si(frame)
                group = file.create_group(f"data/demo_{k}")
                group.attrs["num_samples"] = len(new)
                group["obs/motor_pos"] = new[["pos_1", "pos_2"]].to_numpy()
                group["obs/motor_torque"] = new[["cur_1", "cur_2"]].to_numpy()
                group["obs/joint_pos"] = new[JOINTS].to_numpy()
                group["rewards"] = np.zeros(len(new))
                group["dones"] = (np.arange(len(new)) == len(new) - 1).astype(int)

    def alohas(folder: Path) -> None:
        for k, frame in enumerate(logs):
            aloha(folder / f"episode_{k}.hdf5", frame)

    def mimics(folder: Path) -> None:
        for k, frame in enumerate(logs):
            robomimic(folder / f"demo_{k}.hdf5", [frame])

    def together(folder: Path) -> None:
        robomimic(folder / "low_dim.hdf5", [logs[0], logs[1].iloc[:800]])

    two = ["episode_0.hdf5", "episode_1.hdf5"]
    demos = ["demo_0.hdf5", "demo_1.hdf5"]
    names = {c: f"observations/{n}" for c, n in zip(MOTORS, ("qpos.0", "effort.0"))}
    names |= {c: f"observations/{n}" for c, n in zip(MOTORS[2:], ("qpos.1", "effort.1"))}
    rig = hand(names, si=True)
    make = "rig from-logs"
    return [
        Case("ALOHA", kind, make, two, alohas, logs, NO_TIME, refs=True),
        Case(
            "ALOHA, a rig",
            kind,
            "estimate",
            two[:1],
            alohas,
            logs[:1],
            NO_TIME,
            rig,
            hand(),
        ),
        Case("robomimic", kind, make, demos, mimics, logs, NO_TIME, refs=True),
        Case(
            "robomimic, two demos",
            kind,
            make,
            ["low_dim.hdf5"],
            together,
            logs,
            NO_TIME,
            refs=True,
        ),
    ]


def registers() -> list[Case]:
    """Registers with a sign that were read without one; the logs begin below zero."""

    def shifted(k: int, shift: tuple[int, int], begin: int = 0) -> pd.DataFrame:
        frame = base(k, begin)
        frame["pos_1"] -= shift[0]
        frame["pos_2"] -= shift[1]
        return frame

    def begins(k: int) -> pd.DataFrame:
        frame = base(k)
        below = (frame[["cur_1", "cur_2"]] < -2).all(axis=1)
        return base(k, int(below.to_numpy().argmax()))

    def by_bit(bit: int, *columns: str) -> Callable[[pd.DataFrame], list[list[str]]]:
        def change(frame: pd.DataFrame) -> pd.DataFrame:
            for column in columns:
                values = frame[column].round()
                frame[column] = np.where(values < 0, 2**bit - values, values)
            return frame

        return changed(change)

    def by_wrap(*columns: str) -> Callable[[pd.DataFrame], list[list[str]]]:
        return changed(lambda f: f.assign(**{c: f[c].round() % 65536 for c in columns}))

    def case(
        name: str,
        kind: str,
        frames: list[pd.DataFrame],
        change: Callable[[pd.DataFrame], list[list[str]]],
        shift: tuple[int, int] = (0, 0),
        command: str = "estimate",
    ) -> Case:
        words = SIGN_BIT if kind.startswith("sign") else WRAP16
        rig = hand(shift=shift)
        return of_text(name, kind, command, frames, change, words, rig=rig, clean_rig=rig)

    both, efforts = ("pos_1", "pos_2"), ("cur_1", "cur_2")
    below, far, make = (500, -100), (900, 50), "rig from-logs"
    sign, wrap = "sign in a bit", "unsigned 16 bits"
    return [
        case("positions", sign, [shifted(0, below)], by_bit(15, *both), below),
        case("one position", sign, [shifted(2, far)], by_bit(15, "pos_1"), far),
        case("always below zero", sign, [base(3)], by_bit(15, "pos_2")),
        case("load", sign, [begins(0)], by_bit(10, *efforts)),
        case("one load", sign, [begins(2)], by_bit(10, "cur_2")),
        case(
            "from logs",
            sign,
            [shifted(0, below), shifted(3, below)],
            by_bit(15, *both),
            below,
            make,
        ),
        case("load, from logs", sign, [begins(0), begins(2)], by_bit(10, *efforts), command=make),
        case("positions", wrap, [shifted(3, below)], by_wrap(*both), below),
        case("one position", wrap, [shifted(0, far)], by_wrap("pos_1"), far),
        case("always below zero", wrap, [base(2)], by_wrap("pos_2")),
        case("currents", wrap, [begins(3)], by_wrap(*efforts)),
        case("one current", wrap, [begins(0)], by_wrap("cur_1")),
        case(
            "from logs", wrap, [shifted(2, below), shifted(3, below)], by_wrap(*both), below, make
        ),
        case("currents, from logs", wrap, [begins(3), begins(0)], by_wrap(*efforts), command=make),
    ]


LINK = '<geom type="capsule" size=".006" fromto="0 0 0 0 0 .03"/>'


def model(joints: Sequence[str], tendons: str, actuators: str) -> str:
    """Return a MuJoCo model of a chain of hinges."""
    body, end = "", ""
    for k, name in enumerate(joints):
        body += f'<body pos="0 0 {0.03 if k else 0}"><joint name="{name}" axis="1 0 0" '
        body += f'range="-.2 1.5" damping=".03" armature="1e-4"/>{LINK}'
        end += "</body>"
    return (
        '<mujoco><compiler angle="radian" autolimits="true"/>'
        f"<worldbody>{body}{end}</worldbody><tendon>{tendons}</tendon>"
        f"<actuator>{actuators}</actuator></mujoco>"
    )


def fixed_tendons() -> list[Case]:
    """Fixed tendons of MuJoCo that sum angles."""

    def tendon(name: str, **coefs: float) -> str:
        parts = "".join(f'<joint joint="{joint}" coef="{c}"/>' for joint, c in coefs.items())
        return f'<fixed name="{name}">{parts}</fixed>'

    def case(name: str, text: str) -> Case:
        def write(folder: Path) -> None:
            (folder / "model.xml").write_text(text, encoding="utf-8")

        kind = "MJCF tendon of angles"
        return Case(name, kind, "rig from-mjcf", ["model.xml"], write, [base(0)], NO_LENGTHS)

    motor = '<motor name="m1" tendon="t1" ctrlrange="-1 1"/>'
    position = '<position name="p{0}" tendon="t{0}" kp="2" ctrlrange="-1 3"/>'
    general = '<general name="g" tendon="t1" ctrlrange="0 1" gainprm="2" biastype="affine" '
    general += 'biasprm="0 -2 -.1"/>'
    sums = tendon("t1", mcp=1, pip=1) + tendon("t2", mcp=1, pip=-1)
    shares = tendon("t1", mcp=0.4, pip=0.35, dip=0.25)
    ratio = tendon("t1", pip=1, dip=-0.77)
    drives = position.format(1) + position.format(2)
    return [
        case("sum and difference", model(["mcp", "pip"], sums, drives)),
        case("shares", model(["mcp", "pip", "dip"], shares, general)),
        case("ratio", model(["mcp", "pip", "dip"], ratio, motor)),
    ]


def write_bag(
    path: Path,
    frame: pd.DataFrame,
    messages: Callable[[int, dict[str, float]], list[tuple[str, list[str], list[Any], list[Any]]]],
) -> None:
    """Write a bag of ROS 2 with JointState only.

    Args:
        messages: number and row → topic, names, positions and efforts of each message.
    """
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.enums import StoragePlugin
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state = store.types["sensor_msgs/msg/JointState"]
    header = store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = dict[str, Any]()
        for k, row in enumerate(in_si(frame).to_dict("records")):
            ns = 1_760_000_000_000_000_000 + round(row["time"] * 1e9)
            at = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            for topic, names, positions, efforts in messages(k, row):
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, state.__msgtype__, typestore=store)
                message = state(
                    header=at,
                    name=names,
                    position=np.array(positions, float),
                    velocity=np.array([]),
                    effort=np.array(efforts, float),
                )
                data = store.serialize_cdr(message, state.__msgtype__)
                writer.write(topics[topic], ns, data)


def bags() -> list[Case]:
    """Bags with nothing but JointState."""
    drives, fingers = ["motor_1", "motor_2"], ["index_mcp", "index_pip"]
    Messages = list[tuple[str, list[str], list[Any], list[Any]]]

    def motors(row: dict[str, float]) -> tuple[list[str], list[Any], list[Any]]:
        return drives, [row["pos_1"], row["pos_2"]], [row["cur_1"], row["cur_2"]]

    def joints(row: dict[str, float]) -> tuple[str, list[str], list[Any], list[Any]]:
        return "/joint_states", fingers, [row[name] for name in JOINTS], []

    def plain(k: int, row: dict[str, float]) -> Messages:
        return [("/motor_states", *motors(row)), joints(row)]

    def one_topic(k: int, row: dict[str, float]) -> Messages:
        _, positions, efforts = motors(row)
        angles = [row[name] for name in JOINTS]
        return [("/joint_states", drives + fingers, positions + angles, [*efforts, 0.0, 0.0])]

    def no_effort(k: int, row: dict[str, float]) -> Messages:
        names, positions, _ = motors(row)
        return [("/motor_states", names, positions, []), joints(row)]

    def some_effort(k: int, row: dict[str, float]) -> Messages:
        names, positions, efforts = motors(row)
        there = efforts if k < 300 or k % 3 else []
        return [("/motor_states", names, positions, there), joints(row)]

    def order(k: int, row: dict[str, float]) -> Messages:
        turn = -1 if k >= 700 else 1
        names, positions, efforts = motors(row)
        topic, fingers, angles, _ = joints(row)
        back = -1 if k % 2 else 1
        motor = ("/motor_states", names[::turn], positions[::turn], efforts[::turn])
        return [motor, (topic, fingers[::back], angles[::back], [])]

    def zeros(k: int, row: dict[str, float]) -> Messages:
        other = ("/motor_states", drives, [0.0, 0.0], [0.0, 0.0])
        return [*plain(k, row), other]

    def late_zeros(k: int, row: dict[str, float]) -> Messages:
        other = ("/motor_states", drives, [0.0, 0.0], [0.0, 0.0])
        return [other, *plain(k, row)] if k >= 600 else plain(k, row)

    def case(
        name: str,
        command: str,
        messages: Callable[[int, dict[str, float]], Messages],
        words: str,
        topic: str = "/motor_states",
        dead: tuple[str, ...] = (),
    ) -> Case:
        logs = [base(0), base(2)] if command == "rig from-logs" else [base(3)]
        odd = [f"bag_{k}" for k in range(len(logs))]

        def write(folder: Path) -> None:
            for path, frame in zip(odd, logs):
                write_bag(folder / path, frame, messages)

        parts = zip(MOTORS, ("motor_1", "motor_1", "motor_2", "motor_2"))
        fields = {"pos": "position", "cur": "effort"}
        columns = {c: f"{topic}[{motor}].{fields[c[:3]]}" for c, motor in parts}
        return Case(
            name,
            "bag of JointState",
            command,
            odd,
            write,
            logs,
            words,
            hand(columns, si=True),
            hand(),
            refs=command == "rig from-logs",
            dead=dead,
        )

    make, both = "rig from-logs", ("cur_1", "cur_2")
    either = r"--drive"
    return [
        case("two topics", make, plain, either),
        case("one topic", make, one_topic, either, "/joint_states"),
        case("no effort", make, no_effort, f"{EFFORT}|{either}", dead=both),
        case("no effort, a rig", "estimate", no_effort, EFFORT, dead=both),
        case("effort at times, a rig", "estimate", some_effort, EFFORT),
        case("order changes", make, order, f"{NAMES}|{either}"),
        case("order changes, a rig", "estimate", order, NAMES),
        case("zeros beside", make, zeros, TWICE),
        case("zeros beside, a rig", "estimate", zeros, TWICE),
        case("zeros from 6 s, a rig", "estimate", late_zeros, TWICE),
    ]


def references() -> list[Case]:
    """References that mirror for some frames, or wrap."""

    def mirrored(*parts: tuple[int, int], joint: int = 0) -> Callable[[Any], list[list[str]]]:
        def change(frame: pd.DataFrame) -> pd.DataFrame:
            values = frame[JOINTS[joint]].to_numpy(copy=True)
            large = np.flatnonzero(np.abs(values) > 25)
            for share, count in parts:
                begin = int(large[len(large) * share // 100])
                values[begin : begin + count] *= -1
            return frame.assign(**{JOINTS[joint]: values})

        return changed(change)

    def shown(name: str, k: int, change: Callable[[pd.DataFrame], list[list[str]]]) -> Case:
        one = of_text(name, kind, "estimate", [base(k)], change, MIRROR, refs=True)
        names, write = texts("log", one.frames, change)
        return replace(one, odd=names, write=write)

    kind = "reference mirrors"
    few, many = ((15, 3), (55, 7)), ((10, 25), (40, 12), (70, 3), (85, 18))
    pair = [base(0), base(3)]
    found = [
        shown("few frames, estimate", 2, mirrored(*few)),
        shown("many frames, estimate", 0, mirrored(*many, joint=1)),
        of_text("few, from logs", kind, "rig from-logs", pair, mirrored(*few), MIRROR),
        of_text("many, from logs", kind, "rig from-logs", pair, mirrored(*many, joint=1), MIRROR),
        of_text("fit", kind, "fit", pair, mirrored(*many), MIRROR),
        of_text("learn", kind, "learn", pair, mirrored(*few, joint=1), MIRROR),
    ]

    def wrapped(
        low: float, turned: float = 0.0, joint: int = 0
    ) -> Callable[[Any], list[list[str]]]:
        name = JOINTS[joint]
        return changed(lambda f: f.assign(**{name: (f[name] + turned - low) % 360 + low}))

    kind = "reference wraps"
    turned = 120.0
    rig = hand(turned=turned)
    moved = [frame.copy() for frame in pair]
    for frame in moved:
        frame[JOINTS[0]] += turned
    half: dict[str, Any] = {"rig": rig, "clean_rig": rig}
    found += [
        of_text("0 to 360, fit", kind, "fit", pair, wrapped(0), WRAPS),
        of_text("±180, fit", kind, "fit", moved, wrapped(-180), WRAPS, **half),
        of_text("0 to 360, learn", kind, "learn", pair, wrapped(0), WRAPS),
        of_text("±180, learn", kind, "learn", moved, wrapped(-180), WRAPS, **half),
        of_text(
            "±180, second joint, learn",
            kind,
            "learn",
            pair,
            wrapped(-180, 130, 1),
            WRAPS,
            others=[pair[0].assign(**{JOINTS[1]: pair[0][JOINTS[1]] + 130})],
        ),
    ]
    return found


def all_cases() -> list[Case]:
    """Return all cases, by kind."""
    makers = (currents, clocks, rounded, headers, lists, episodes, registers, fixed_tendons, bags)
    return [case for make in (*makers, references) for case in make()]


def main() -> None:
    """Print what came of each kind, and what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", default="", help="only kinds with these words")
    parser.add_argument("--keep", type=Path, help="folder for the files, which stay there")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    cases = [case for case in all_cases() if asked.kind in case.kind]
    with tempfile.TemporaryDirectory() as made:
        home = (asked.keep or Path(made)).resolve()

        def one(numbered: tuple[int, Case]) -> Judged:
            folder = home / f"{numbered[0]:03d}"
            if folder.exists() and any(folder.iterdir()):
                raise SystemExit(f"{folder} is not empty")
            try:
                found = judge(numbered[1], folder)
            except Exception as problem:
                found = Judged(numbered[1], "broken", why=f"{type(problem).__name__}: {problem}")
            line = f"{numbered[0]:03d} {found.case.kind}: {found.case.name}, {found.verdict}"
            print(f"{line} {found.why}", flush=True)
            return found

        with ThreadPoolExecutor(asked.jobs) as pool:
            results = list(pool.map(one, enumerate(cases)))
    rows = list[list[str]]()
    for kind in dict.fromkeys(case.kind for case in cases):
        own = [result for result in results if result.case.kind == kind]
        counts = [sum(one.verdict == word for one in own) for word in ("right", "named", "wrong")]
        rows.append([kind, str(len(own)), *map(str, counts)])
    columns = ["kind", "cases", "right", "named", "wrong"]
    table("odd_logs", "odd logs", columns, rows)
    for result in results:
        if result.verdict in ("wrong", "broken"):
            print(f"{result.case.kind}: {result.case.name} ({result.case.command}): {result.why}")
            for line in result.last.splitlines():
                print(f"    {line[:400]}")


if __name__ == "__main__":
    main()

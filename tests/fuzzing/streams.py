"""Hostile streams: lines, datagrams and samples of every kind, between good ones; nothing ends the
stream.
"""

from __future__ import annotations

import io
import json
import math
import random
import sys
from contextlib import redirect_stderr, redirect_stdout

import numpy as np

from distal.cli.estimate_command import Session
from distal.estimators import LARGEST_ANGLE
from distal.logs import MessageReader
from distal.rig import Rig
from distal.run import HEALTH, LiveEstimator, Monitor
from tests.fuzzing.outcome import JSON, ODD_CELLS, REFUSED, TAKEN, Outcome, broken

PARAMETERS = (
    0,
    1,
    -1,
    5e-324,
    1e-200,
    -1e-9,
    1e8,
    1e15,
    -1e19,
    1e300,
    -1e308,
    1.8e308,
    math.nan,
    math.inf,
    -math.inf,
    2**63,
    2**64,
    10**400,
    -(10**400),
)
CELLS = (*ODD_CELLS, '"a\rb"', '"' + "1" * 131_073 + '"', "0x1p3")
FAR = 1.0
"""An angle that no good sample here has [rad]: a wild value must not lead `adaptive` there; others
trust every sample.
"""


class Stream:
    """A stream that is fed for as long as it lives: `attempt` after `attempt`, of CSV, JSON lines
    or datagrams.

    Args:
        rig: its sensors name the columns.
        csv: whether lines are CSV; else JSON.
        estimator: which one.
    """

    def __init__(self, rig: Rig, csv: bool, estimator: str = "adaptive") -> None:
        self.live = LiveEstimator(rig, estimator)
        self._reader = MessageReader(rig, self.live.channels)
        self._columns = [
            sensor.log_column for sensor in rig.sensors if sensor.name in self.live.channels
        ]
        self._time = rig.log.time.column
        self._csv, self._at, self._robust = csv, 0.0, estimator == "adaptive"
        self._session = Session(Monitor(self.live), self._reader, as_json=not csv)
        if csv:
            self._answers(",".join([self._time, *self._columns]).encode() + b"\n")
        else:
            self._session.csv = False
        for _ in range(20):
            self._good()

    def _good(self) -> list[str]:
        self._at += self.live.interval
        values = [1e-3 * math.sin(3 * self._at), 2.0, -1e-3 * math.sin(3 * self._at), 2.0][
            : len(self._columns)
        ]
        if self._csv:
            return self._answers(",".join(map(repr, [self._at, *values])).encode() + b"\n")
        return self._answers(
            json.dumps({self._time: self._at, **dict(zip(self._columns, values))}).encode()
        )

    def _answers(self, line: bytes) -> list[str]:
        out, err = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            self._session.take(line)
        return out.getvalue().splitlines()

    def attempt(self, seed: int) -> Outcome:
        """Feed one hostile input, then good samples, and return whether the stream went on as it
        promises.

        Args:
            seed: of the input.
        """
        rng = random.Random(seed)
        line = self._line(rng)
        try:
            answers = self._answers(line)
        except Exception as problem:
            return broken(line, problem)
        blank = not line.decode("utf-8", "replace").strip().lstrip("\ufeff").strip()
        if len(answers) != (0 if blank else 1):
            return broken(line, f"{len(answers)} answers")
        for answer in answers:
            if not self._well_formed(answer):
                return broken(line, answer)
        refused = any("bad" in answer for answer in answers)
        if self.live.samples and self.live.time > self._at:
            # a stamp far ahead: samples that follow are late until the clock is taken as set back
            self._at = max(self._at, 0.0)
        for _ in range(6):
            answers = self._good()
        if not self._recovered(answers[0]):
            return broken(line, f"afterwards: {answers[0]}")
        diagonal = np.diagonal(self.live.covariance)
        if not (np.isfinite(diagonal).all() and diagonal.min() >= 0.0):
            return broken(line, f"a variance is {diagonal.min()}")
        return REFUSED if refused else TAKEN

    def _line(self, rng: random.Random) -> bytes:
        kind = rng.randrange(6)
        if kind == 0:
            return bytes(rng.randrange(256) for _ in range(rng.randrange(60)))
        stamp = self._at + self.live.interval if rng.random() < 0.6 else rng.choice(PARAMETERS)
        if self._csv:
            cells = [
                repr(stamp),
                *(
                    rng.choice([repr(rng.choice(PARAMETERS)), rng.choice(CELLS), "2.0"])
                    for _ in self._columns
                ),
            ]
            if kind == 1:
                cells = cells[: rng.randrange(len(cells) + 1)] + cells[: rng.randrange(3)]
            line = ",".join(cells).encode("utf-8", "replace")
        else:
            message: object = {
                self._time: stamp if rng.random() < 0.7 else rng.choice(JSON),
                **{
                    name: rng.choice([rng.choice(PARAMETERS), rng.choice(JSON), 2.0])
                    for name in self._columns
                },
            }
            if kind == 1:
                message = rng.choice([message, [message], rng.choice(JSON), {"a": {"b": message}}])
            line = _json(message).encode()
        if kind == 2:
            at = rng.randrange(len(line) + 1)
            line = line[:at] + bytes([rng.randrange(256)]) + line[at + rng.randrange(2) :]
        if kind == 3 and rng.random() < 0.2:
            line = rng.choice([b"[" * 5000, b'{"a":' * 3000, line * 300, b" " * 2000 + line])
        return line.replace(b"\n", b" ")

    def _well_formed(self, answer: str) -> bool:
        if self._csv:
            return answer.count('"') in (0, 2) and answer.split(",")[3] in HEALTH
        read = json.loads(answer)
        stds = [value for name, value in read.items() if name.endswith("_std")]
        return read["health"] in HEALTH and all(std is None or std >= 0.0 for std in stds)

    def _recovered(self, answer: str) -> bool:
        theta = answer.split(",")[1] if self._csv else json.loads(answer)["theta"]
        return theta not in ("", None) and abs(float(theta)) < (
            FAR if self._robust else LARGEST_ANGLE
        )


def _json(message: object) -> str:
    limit = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)
    try:
        return json.dumps(message)
    finally:
        sys.set_int_max_str_digits(limit)

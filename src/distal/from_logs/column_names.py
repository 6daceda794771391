"""What each column is by its name and its values: its role, its unit and its subject.

Words in five languages, and each unit, speak for and against roles by a logarithm of odds, and
these add up (naive Bayes). Columns of one subject are a family: where one of them is a current or
a command, the subject is a drive, whatever its name, and one of the others is its position. Values
show noise, steps and wraps; the unit is as the header says it, else by words and the range of
values.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Literal, get_args
from unicodedata import combining, name, normalize

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError, UnitError
from distal.rig import COUNTS
from distal.units import unit_factor

Role = Literal["position", "effort", "angle", "command", "time", "other"]
"""Position and effort are a drive's, an angle is a joint's reference."""

ROLES: tuple[Role, ...] = get_args(Role)

SURE = 2.0
"""Margin of the best role before the next from which it is sure [1]. Source: definition (a
logarithm of odds: 88 %).
"""

LIKELY = 1.0
"""The same from which it is likely [1]. Source: definition (73 %)."""

WORDS: Mapping[str, str] = {
    "time": "t time zeit temps tiempo tempo stamp timestamp clock stempel sec secs seconds "
    "millis ms us ns",
    "position": "ticks tick counts count multiturn recorrido posmotor motorpos servopos stroke hub "
    "course carrera corsa phi mpos",
    "encoder": "enc encoder",
    "travel": "disp displacement weg travel",
    "symbol": "x",
    "place": "pos position posicion posizione stellung jp",
    "drive": "motor rotor servo drive actuator actuation spool antrieb moteur motore tendon cable "
    "seil cavo m actuador attuatore slider",
    "proximal": "prox proximal",
    "force": "force kraft fuerza forza tension zug f fx fz traction trazione tensione",
    "torque": "torque drehmoment moment couple coppia par tau",
    "current": "cur curr current strom courant corriente corrente amps i iq",
    "effort": "effort load loadcell cell zelle u lc fsr",
    "angle": "theta angle rotation winkel angulo angolo camera cam kamera camara mocap vicon "
    "optitrack fiducial aruco goniometer gonio inclinometer tag",
    "truth": "truth true",
    "joint": "joint link junta external gelenk articulation articulacion giunto",
    "reference": "ref reference",
    "finger": "q mcp pip dip cmc ip wrist elbow finger thumb middle ring pinky knee yaw pitch roll "
    "jaw hand poignet doigt muneca dedo polso dito handgelenk daumen flex flexion abd abduction "
    "tilt twist splay spread inclination bend bending orientation deflection heading neck shoulder "
    "hip ankle toe trunk th knuckle neigung beugung inclinaison inclinacion inclinazione",
    "index": "index",
    "side": "links rechts left right upper lower inner outer front rear distal tip gauche droite "
    "izquierda derecha sinistra destra",
    "command": "cmd command goal target setpoint sp soll sollwert consigne consigna comando "
    "commanded tgt ctrl referencia desired befehl action des ziel cible objetivo obiettivo input "
    "demand set requested",
    "unused": "speed vel velo velocit velocid geschwindigkeit vitesse omega acc accel "
    "acceleration dot rate rpm dps gyro mvel dq qd ddq qdd hz temp temperatur volt "
    "voltage spannung voltaje battery vbat bus error err diff humidity pressure",
    "other": "pwm duty idx frame seq row episode dt status mode flag unnamed checksum quality conf "
    "confidence",
    "empty": "observation state data msg value reading id present actual act measured ist estimate "
    "estimated est feedback fb",
}
"""Kind of word → words, in English, German, French, Spanish and Italian; the empty ones say neither
what is measured nor of what.
"""

SHORTEST = 5
"""Number of letters of a word which is no stem of others. Source: judgement."""

OWNERS = ("drive", "proximal", "joint")
"""Kinds of words that say whose a column is."""

ALWAYS = ("command", "unused", "truth", "reference", "finger", "index")
"""Kinds of words that count in any part of a path."""

OF_WHAT = ("finger", "proximal", "side")
"""Kinds of words that say of what something is measured."""

KIND_OF = {word: kind for kind, text in WORDS.items() for word in text.split()}
"""Word → its kind."""

EVIDENCE: Mapping[str, Mapping[Role, float]] = {
    "time": {"time": 3.0},
    "position": {"position": 3.0},
    "encoder": {"position": 2.0},
    "travel": {"position": 3.0},
    "symbol": {"position": 3.0},
    "place": {"position": 1.2},
    "drive": {"position": 1.5, "angle": -9.0},
    "proximal": {"position": 1.5, "angle": -9.0},
    **{of: {"effort": 3.0, "angle": -6.0} for of in ("force", "torque", "current", "effort")},
    "angle": {"angle": 3.0, "position": 1.0},
    "truth": {"angle": 3.0, "effort": -9.0, "other": 2.0},
    "joint": {"angle": 3.0, "position": -1.5},
    "finger": {"angle": 1.2},
    "reference": {"angle": 1.2},
    "index": {"angle": 1.2, "other": 2.0},
    "command": {"command": 12.0},
    "unused": {"other": 15.0},
    "other": {"other": 3.0},
}
"""Kind of word → role → logarithm of the odds that it speaks for that role [1]; 3 is 20 to 1.
Source: judgement, checked by `benchmarks.from_logs columns`, seeds 7600 to 7635.
"""

NOT_OF_UNIT: Mapping[Role, float] = {**dict.fromkeys(ROLES, -6.0), "other": -3.0}
"""What a unit says of roles that it does not name; it may stand beside any other column."""

OF_UNIT: Mapping[str, Mapping[Role, float]] = {
    "s": {"time": 1.0},
    "rad": {"position": 1.0, "angle": 1.0},
    "m": {"position": 2.5},
    "count": {"position": 2.5},
    "N": {"effort": 1.0},
    "N m": {"effort": 1.0},
    "A": {"effort": 1.0},
    "V": {"other": 1.0},
    "K": {"other": 1.0},
    "": {"other": 1.0, "effort": 0.0},
}
"""SI unit → role → the same logarithm of odds."""

UNITS: Mapping[str, Mapping[str, str]] = {
    "s": {"s": "s sec secs seconds", "ms": "ms millis", "us": "us", "ns": "ns", "min": "min"},
    "rad": {"rad": "rad rads radians", "deg": "deg degree degrees grad °"},
    "m": {"m": "m", "mm": "mm", "cm": "cm", "um": "um"},
    "count": {"count": "count counts cnt tick ticks step steps pulses qc inc"},
    "N": {
        "N": "n newton",
        "mN": "mn",
        "gf": "g gf gram grams",
        "kgf": "kg kgf kp",
        "lbf": "lb lbs lbf",
    },
    "N m": {"N m": "nm", "mN m": "mnm", "N cm": "ncm", "N mm": "nmm", "kgf cm": "kgcm"},
    "A": {"A": "a amps", "mA": "ma"},
    "V": {"V": "v", "mV": "mv"},
    "K": {"degC": "c °c degc"},
    "": {"%": "% pct percent"},
}
"""SI unit of a dimension → unit as a rig file has it → how headers write it."""

SPELLED = {
    text: (unit, si)
    for si, units in UNITS.items()
    for unit, texts in units.items()
    for text in texts.split()
}
"""How a header writes a unit → the unit, and the SI unit of its dimension."""

NO_SCALE = frozenset(["load", "raw", "register", "lsb", "pwm", "duty", "pct", "percent"])
"""Words of an effort whose scale no log tells; it is taken as a current's."""

_PATH = re.compile(r"[/.:|]")
_BRACKETS = re.compile(r"^(.+?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")
_LIKE_UNIT = re.compile(r"[^\W\d_][^\d_]{0,11}")
# of single letters only these are units: F_a is a force of a, i_A is in A
_ENDING = re.compile(r"^(?:(.*)[_ ./-])?([A-Za-z°]{2,}|[smgANV°])$")
_TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[^\W\da-zA-Z_]+")
# the current that makes a motor's torque, not a current of q
_AXIS_OF_CURRENT = re.compile(r"(?i)(?<![a-z])[qd][_ ]?(?=cur)")
# a compound is made of two words, neither of them a symbol of one or two letters
_PART = "|".join(word for word in KIND_OF if len(word) > len("th"))
_COMPOUND = re.compile(f"({_PART})({_PART})")


@dataclass(frozen=True)
class NameEvidence:
    """What a name says: how much it speaks for each role, its unit, and whose column it is.

    Args:
        scores: role → logarithm of odds.
        kinds: of its words (`WORDS`).
        unit: as a rig file has it, None where the name has none.
        si: SI unit of its dimension.
        subject: what is left of the name without these words: which drive or joint.
        quantity: these words: what is measured.
        has_scale: whether an effort of this name may have one.
        unknown_unit: what stands in brackets where a unit stands, and is none that is known.
    """

    scores: Mapping[Role, float]
    kinds: tuple[str, ...]
    unit: str | None
    si: str | None
    subject: str
    quantity: tuple[str, ...]
    has_scale: bool
    unknown_unit: str = ""

    @property
    def best(self) -> Role:
        """The role for which it speaks most."""
        return best_role(self.scores)

    @property
    def margin(self) -> float:
        """How much more it speaks for a position than for an angle."""
        return self.scores["position"] - self.scores["angle"]

    @property
    def kind_of_name(self) -> tuple[object, ...]:
        """What it shares with columns of the same kind: what is measured and how many words there
        are, else its words without numbers and known ones.
        """
        words = [word for word in self.subject.split("_") if word]
        return (
            (*self.quantity, len(words))
            if self.quantity
            else tuple(w for w in words if w.isalpha() and w not in KIND_OF)
        )

    @property
    def says_nothing(self) -> bool:
        """Whether neither a word nor a unit is known."""
        return not self.kinds and self.unit is None and not self.unknown_unit


def best_role(scores: Mapping[Role, float]) -> Role:
    """Return the role with the largest logarithm of odds."""
    return max(ROLES, key=lambda role: scores[role])


Names = Mapping[str, NameEvidence]
"""Header of a column → what its name says."""


def words_of(header: str) -> list[str]:
    """Return the words of a name in lower case: `posMotor_2` gives pos, motor, 2; `Motorwinkel`
    gives motor, winkel; θ is theta.
    """
    plain = ""
    for letter in normalize("NFKD", header):
        if "GREEK" in name(letter, ""):
            plain += f" {name(letter).split()[-1].lower()} "
        elif not combining(letter):
            plain += letter
    words = list[str]()
    for word in _TOKEN.findall(plain):
        compound = None if word.lower() in KIND_OF else _COMPOUND.fullmatch(word.lower())
        words.extend(compound.groups() if compound else [_stem(word.lower())])
    return words


def _stem(word: str) -> str:
    """Return the known word of which a word is the plural or another form, which has its first
    letters; any other word as it is.
    """
    stems = [word, word.removesuffix("s"), *(word[:n] for n in range(len(word) - 1, SHORTEST, -1))]
    return next((stem for stem in stems if stem in KIND_OF), word)


def name_evidence(header: str, others: Iterable[str] = ()) -> NameEvidence:
    """Return what the header of a column says, beside those of other columns: A and B at their ends
    are no units.
    """
    match = _BRACKETS.match(header)
    base, bracket = match.groups() if match else (header, "")
    unit, si = _unit(bracket)
    unknown = bracket if unit is None and _LIKE_UNIT.fullmatch(bracket) else ""
    ending = _ENDING.match(base) if unit is None else None
    letters = {h[-1] for h in others if h[:-1] == header[:-1]}
    if ending and letters <= {*SPELLED, "A", "V", "N"} and ending[2].lower() in SPELLED:
        at_end = SPELLED[ending[2].lower()]
        if ending[1] or at_end[1] == "s":  # a name that is only ms is a time
            base = ending[1] or base
            unit, si = at_end
    parts = [words_of(part) for part in _PATH.split(_AXIS_OF_CURRENT.sub("", base))]
    words = [word for part in parts for word in part]
    # a single letter is a symbol at the beginning only, of a recording's column after its topic:
    # F_mcp_f is the force of mcp_f
    topic = base.partition(".")[0] if base.startswith("/") else ""
    first = len(words_of(topic))
    at = [number for number, part in enumerate(parts) for _ in part]
    telling = [
        (at[i], KIND_OF[word])
        for i, word in enumerate(words)
        if (i == first or len(word) > 1 or (word == "m" and words[i + 1 : i + 2] > ["0"]))
        and KIND_OF.get(word, "empty") != "empty"
    ]
    # the last part of a path that says whose a column is counts, and the last that says what;
    # of each kind once: /actuator_states/actuator_currents is of an actuator as currents are
    last = {kind in OWNERS: part for part, kind in telling if kind not in ALWAYS}
    kinds = list(
        dict.fromkeys(k for part, k in telling if k in ALWAYS or part == last[k in OWNERS])
    )
    if "/s" in bracket.replace(" ", ""):
        kinds.append("unused")
    if "index" in kinds and len(words) > 1:  # the finger, not a number of rows
        kinds[kinds.index("index")] = "finger"
    if "proximal" in kinds and "joint" in kinds:  # of a finger's joints the first
        kinds[kinds.index("proximal")] = "finger"
    if "finger" in kinds and "f" in words[:1] and words[1].isdigit():
        kinds.remove("force")  # f1_mcp is of the first finger
    if "current" in kinds and {"place", "position", "unused"} & set(kinds):
        kinds.remove("current")  # the present one
    evidence = [EVIDENCE.get(kind, {}) for kind in kinds]
    if si is not None:
        evidence.append({**NOT_OF_UNIT, **OF_UNIT[si]})
    kept = [
        word
        for i, word in enumerate(words)
        if (len(word) == 1 and (i > 0 or word.isdigit()))
        or (KIND_OF.get(word, "finger") in OF_WHAT and (len(word) > 1 or len(words) == 1))
    ]
    return NameEvidence(
        {role: sum(each.get(role, 0.0) for each in evidence) for role in ROLES},
        tuple(kinds),
        unit,
        si,
        "_".join(kept),
        tuple(word for word in words if word not in kept and KIND_OF.get(word) != "empty"),
        si != "" and (si is not None or not NO_SCALE & set(words)),
        unknown,
    )


def with_families(names: Names) -> Names:
    """Return what the names of columns say together.

    The subject of an effort or a command is a drive. Of its other columns the one that speaks most
    for a position is its position, and so is that of every other subject which is called alike.
    """
    drives = {
        name.subject
        for name in names.values()
        if name.best in ("effort", "command") and name.scores[name.best] >= LIKELY
    }
    efforts = {name.subject for name in names.values() if name.best == "effort"}
    movers = {
        header: name
        for header, name in names.items()
        if name.best in ("position", "angle") or name.says_nothing
    }
    are_named = any(name.margin >= LIKELY for name in movers.values())
    of_drives = set[str]()
    for drive in drives:
        family = [
            header
            for header, name in movers.items()
            if name.subject == drive or (drive in efforts and _shares(name, drive))
        ]
        chosen = max(
            family, key=lambda h: (names[h].margin, names[h].scores["position"]), default=None
        )
        # where other columns are called positions, one that is called an angle is a joint's
        if chosen is not None and not (are_named and names[chosen].margin <= -LIKELY):
            of_drives.add(chosen)
    quantities = {(names[header].quantity, names[header].unit) for header in of_drives}
    result = dict(names)
    for header, mover in movers.items():
        is_alike = bool(mover.quantity) and (mover.quantity, mover.unit) in quantities
        if (is_alike or header in of_drives) and mover.margin < SURE:
            result[header] = as_role(mover, "position")
    angles = [header for header in movers if result[header].scores["angle"] >= LIKELY]
    truths = {h: names[h].scores["angle"] for h in angles if "truth" in names[h].kinds}
    for header, score in truths.items():
        # where another is called a true angle, a true position is a drive's, as in a simulation
        if "place" in names[header].kinds and score < max(truths.values()):
            result[header] = as_role(names[header], "other")
    references = [header for header in angles if "reference" in names[header].kinds]
    for header in references if len(angles) > len(references) else ():
        # where other columns are joints, this is what a drive should do
        if names[header].subject and names[header].subject in drives:
            result[header] = as_role(names[header], "command")
    return result


def _shares(name: NameEvidence, drive: str) -> bool:
    """Return whether a name in which no word is known shares a word and its numbers with a drive's:
    ``dianji1_weizhi`` and the current ``dianji1_dianliu``.
    """
    words = {*name.subject.split("_")}
    others = {*drive.split("_")}
    digits = {word for word in words | others if word.isdigit()}
    return not name.kinds and digits < words & others


def as_role(name: NameEvidence, role: Role) -> NameEvidence:
    """Return what a name says with its family or its values, which say its role."""
    scores = {**name.scores, "angle": -SURE, role: max(name.scores.values()) + SURE}
    return replace(name, scores=scores, kinds=(*name.kinds, "drive"))


def dimension_of(unit: str, dimensions: Iterable[str]) -> str | None:
    """Return that of `dimensions`, SI units, which a unit has, None where it has none of them."""
    for si in dimensions:
        try:
            unit_factor(unit, si)
        except UnitError:
            continue
        return si
    return None


def _unit(text: str) -> tuple[str | None, str | None]:
    """Return a unit in brackets as a rig file has it, and the SI unit of its dimension."""
    plain = re.sub(r"[\s·*.]+", "", text).lower()
    if plain in SPELLED:
        return SPELLED[plain]
    si = dimension_of(text, ("s", "rad", "m", "N", "N m", "A")) if text else None
    return (None, None) if si is None else (text, si)


Sureness = Literal["sure", "likely", "a guess", "assumed"]
"""How sure something is. An assumed unit is that of a scale that no log tells, as of a load in
percent.
"""

USUAL_RANGE: Mapping[Role, Mapping[str, Mapping[str, float]]] = {
    "time": {"": {"s": 10.0}},
    "angle": {"": {"rad": 0.8, "deg": 46.0}},
    "position": {
        "symbol": {"m": 0.006, "rad": 1.7, "mm": 30.0, "count": 1000.0},
        "travel": {"m": 0.016, "mm": 16.0, "count": 1000.0},
        "": {"m": 0.006, "rad": 1.7, "deg": 97.0, "count": 1000.0},
    },
    "effort": {
        "current": {"A": 0.3, "mA": 300.0},
        "force": {"N": 10.0},
        "torque": {"N m": 1.0},
    },
}
"""Role → kind of a word, or none → unit → usual range of a column in it, where the header has no
unit. The nearest one is taken, by the ratio. Source: judgement (fingers and their motors).
"""

TAKEN_FORCES = {"mA": "cN", "A": "daN"}
"""Unit of a current → that of a force which is taken for it where a drive moves in a line, 10 N for
an ampere. Source: judgement (small lead screws).
"""


@dataclass(frozen=True)
class ColumnRole:
    """What a column is.

    Args:
        header: as the logs have it.
        role: time, position or effort of a drive, angle of a joint, command, or other.
        part: name of the drive or joint, empty for time and other.
        unit: of its values, as a rig file has it; empty where it has none.
        si: SI unit of its dimension; "count" for an encoder's counts.
        sureness: of the role.
        unit_sureness: of the unit.
        evidence: why, in a line.
        values: what its values say.
        rate: of its samples [Hz].
    """

    header: str
    role: Role
    part: str
    unit: str
    si: str
    sureness: Sureness
    unit_sureness: Sureness
    evidence: str
    values: ValueEvidence
    rate: float = 0.0

    @property
    def in_words(self) -> str:
        """All of it in a line."""
        of = f" of {self.part}" if self.part else ""
        doubt = "" if self.unit_sureness == "sure" else f" ({self.unit_sureness})"
        unit = f" in {self.unit}{doubt}" if self.unit else ""
        unit = " of an assumed scale" if self.unit_sureness == "assumed" else unit
        return f"{self.header}: {self.role}{of}{unit}, {self.sureness}: {self.evidence}"


Columns = Sequence[ColumnRole]
"""What the columns of some logs are, in their order."""


def of_role(columns: Columns, *roles: Role) -> list[ColumnRole]:
    """Return the columns that have one of some roles."""
    return [column for column in columns if column.role in roles]


def with_units(columns: Columns, names: Names, drives: Mapping[str, str]) -> list[ColumnRole]:
    """Return columns with their units: as a user or the header says, else by the words of the name
    and the range of the values. The current of a drive that moves in a line becomes a force of a
    taken scale; where a header gives its unit in brackets it stays, and cannot be used.

    Args:
        columns: with their roles and parts.
        names: header → what its name says.
        drives: header → the unit that a user gave.

    Raises:
        LogError: a user's unit is none of a length or an angle.
    """
    result = {column.header: column for column in columns}
    in_line = set[str]()
    usual = {column.header: _usual_range(column.role, names[column.header]) for column in columns}
    # those of positions first: by them drives move in a line or turn
    for column in sorted(columns, key=lambda column: ROLES.index(column.role)):
        header, role = column.header, column.role
        name = names[header]
        if role == "other":
            continue
        if drives.get(header):
            unit, si, sureness = _drive_unit(header, drives[header])
        elif role == "effort" and not name.has_scale:
            unit, si, sureness = "A", "A", "assumed"
        elif name.unit is not None:
            unit, si, sureness = name.unit, str(name.si), "sure"
        else:
            alike = [c for c in of_role(columns, role) if usual[c.header] == usual[header]]
            width = max(c.values.width for c in alike)
            unit, si, sureness = _unit_by_size(column, usual[header], width, column.part in in_line)
        result[header] = replace(column, unit=unit, si=si, unit_sureness=sureness)
        if role == "position" and si == "m":
            in_line.add(column.part)
        if role == "effort" and unit in TAKEN_FORCES and column.part in in_line:
            result[header] = _as_force(result[header])
    return [*result.values()]


def _as_force(column: ColumnRole) -> ColumnRole:
    """Return a current of a drive that moves in a line as a force of a taken scale."""
    is_sure = column.unit_sureness == "sure"
    if is_sure and column.header.rstrip().endswith("]"):
        return replace(column, role="other", part="")
    sureness = "a guess" if is_sure else column.unit_sureness
    return replace(column, unit=TAKEN_FORCES[column.unit], si="N", unit_sureness=sureness)


def _usual_range(role: Role, name: NameEvidence) -> Mapping[str, float]:
    """Return unit → usual range of a column by its role and its words, empty where none has one."""
    of_role = USUAL_RANGE.get("position" if role == "command" else role, {})
    return next((of_role[kind] for kind in (*name.kinds, "") if kind in of_role), {})


def _unit_by_size(
    column: ColumnRole, usual: Mapping[str, float], width: float, in_line: bool
) -> tuple[str, str, Sureness]:
    """Return the unit whose usual range is nearest to a `width`, its SI unit, and how sure that is;
    an effort of unknown kind is a force of a drive that moves `in_line`, else a torque.
    """
    if not usual:
        unit = "N" if in_line else "N m"
        return unit, unit, "a guess"
    units = [unit for unit in usual if unit != "count" or column.values.is_whole]
    unit = min(units, key=lambda unit: abs(np.log(max(width, 1e-300) / usual[unit])))
    is_likely = len(units) == 1 or unit == "count"
    return unit, SPELLED[unit.replace(" ", "").lower()][1], "likely" if is_likely else "a guess"


def _drive_unit(header: str, unit: str) -> tuple[str, str, Sureness]:
    """Return the unit of a drive's position that a user gave, and its SI unit."""
    if unit in COUNTS:
        return "count", "count", "sure"
    si = dimension_of(unit, ("m", "rad"))
    if si is None:
        raise LogError(
            f"--drive '{header}={unit}': a drive is read in a length or an angle, such as mm or "
            f"deg, or in ticks; '{unit}' is none of these"
        )
    return unit, si, "sure"


NORMAL_MAD = 1.4826
"""Standard deviation per median of absolute values of a normal error. Source: definition (its
75 % quantile).
"""

SECOND_DIFFERENCE = 6.0
"""Variance of x₋₁ − 2x₀ + x₁ per variance of white noise x. Source: definition (1 + 4 + 1)."""

SAME = 1e-9
"""Values whose range is below this share of their size are one value. Source: rounding.
"""

HALF_TURN = 0.5
"""Share of a turn above which a step between neighbours is a wrap. Source: definition (Nyquist: the
shorter way round is taken).
"""

TURNS = np.array([2.0 * pi, 360.0, *2.0 ** np.arange(6, 33)])
"""Periods after which readings wrap: in rad, in deg, of counters. Source: definition (registers
have whole numbers of bits).
"""


@dataclass(frozen=True)
class ValueEvidence:
    """What the values of one column say, over all logs.

    Args:
        low: smallest value.
        high: largest value.
        noise: standard deviation of white noise, from second differences.
        step: smallest difference between different values: the resolution, 0 if it has none.
        is_whole: whether all values are whole numbers.
        is_constant: whether it has one value only.
        stays: largest number of samples in a row with one value.
        turn: counts after which it wraps, None where it does not.
    """

    low: float
    high: float
    noise: float
    step: float
    is_whole: bool
    is_constant: bool
    stays: int
    turn: float | None

    @property
    def width(self) -> float:
        """Difference between the largest and the smallest value."""
        return self.high - self.low


def value_evidence(columns: Sequence[Floats]) -> ValueEvidence:
    """Return what the values of a column in several logs say, (n_samples,) each."""
    finite = (column[np.isfinite(column)] for column in columns)
    present = [values for values in finite if len(values)]
    pooled = np.concatenate(present)
    low = float(pooled.min())
    high = float(pooled.max())
    second = np.concatenate([np.diff(values, 2) for values in present])
    return ValueEvidence(
        low=low,
        high=high,
        noise=NORMAL_MAD * float(np.median(np.abs(second))) / np.sqrt(SECOND_DIFFERENCE),
        step=_step(pooled),
        is_whole=bool(np.all(pooled == np.round(pooled))),
        is_constant=high - low <= SAME * max(abs(low), abs(high), 1e-300),
        stays=max(longest_run(values)[1] for values in present),
        turn=_turn(present, high - low),
    )


def longest_run(values: Floats) -> tuple[int, int]:
    """Return where the longest run of equal values begins, and its number of samples."""
    ends = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0.0)
    lengths = np.diff(ends)
    longest = int(np.argmax(lengths))
    return int(ends[longest]), int(lengths[longest])


def _step(values: Floats) -> float:
    """Return the resolution: the step of which all differences are multiples, 0 if there is
    none.
    """
    different = np.unique(values)
    if len(different) < 3 or len(different) > len(values) / 2:
        return 0.0
    gaps = np.diff(different)
    step = float(np.quantile(gaps, 0.05))
    multiples = gaps / step
    is_grid = np.mean(np.abs(multiples - np.round(multiples)) < 0.1) > 0.9
    return step if is_grid else 0.0


def _turn(columns: Sequence[Floats], width: float) -> float | None:
    """Return after how many counts a column wraps, None where it does not: its
    usual steps are small, and beside them a wrap is a whole turn.
    """
    steps = np.concatenate([np.abs(np.diff(values)) for values in columns])
    wraps = steps[steps > HALF_TURN * width]
    if len(wraps) < 2:
        return None
    usual = np.quantile(steps, 0.95)
    # a step across the wrap is shorter than the turn by what it would be elsewhere
    seen = np.median(wraps) + usual / 2.0
    turn = float(TURNS[np.argmin(np.abs(TURNS - seen))])
    return turn if abs(turn - seen) <= usual and usual < HALF_TURN * width else None

"""What the names of columns say: words in five languages, units behind them, and families.

Each kind of word and each unit speaks for and against roles by a logarithm of odds, and these add
up (naive Bayes). Columns of one subject are a family: where one of them is a current or a command,
the subject is a drive, whatever its name, and one of the others is its position.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args
from unicodedata import combining, name, normalize

from distal.errors import UnitError
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
    "position": "ticks tick counts count recorrido posmotor motorpos servopos stroke hub course "
    "carrera corsa phi mpos",
    "encoder": "enc encoder",
    "travel": "disp displacement weg travel",
    "symbol": "x",
    "place": "pos position posicion posizione stellung jp",
    "drive": "motor servo drive actuator actuation spool antrieb moteur motore tendon cable seil "
    "cavo m actuador attuatore slider",
    "proximal": "prox proximal",
    "force": "force kraft fuerza forza tension zug f fx fz traction trazione tensione",
    "torque": "torque drehmoment moment couple coppia par tau",
    "current": "cur curr current strom courant corriente corrente amps i iq",
    "effort": "effort load loadcell cell zelle u lc fsr",
    "angle": "theta angle winkel angulo angolo camera cam kamera camara mocap vicon optitrack "
    "fiducial aruco goniometer gonio tag",
    "truth": "truth true",
    "joint": "joint external gelenk articulation articulacion giunto",
    "reference": "ref reference",
    "finger": "q mcp pip dip cmc wrist elbow finger thumb knee yaw pitch roll jaw "
    "hand poignet doigt muneca dedo polso dito handgelenk daumen flex flexion abd "
    "abduction tilt inclination bend bending orientation deflection heading neck shoulder hip "
    "ankle toe trunk th knuckle neigung beugung inclinaison inclinacion inclinazione",
    "index": "index",
    "command": "cmd command goal target setpoint sp soll sollwert consigne consigna comando "
    "desired befehl action des ziel cible objetivo obiettivo input demand set requested",
    "unused": "speed vel velocity geschwindigkeit vitesse velocidad velocita omega acc accel "
    "acceleration dot rate rpm gyro mvel dq qd hz temp temperature temperatur volt voltage "
    "spannung voltaje battery vbat bus error err diff humidity pressure",
    "other": "pwm duty idx frame seq row episode dt status mode flag unnamed checksum quality conf "
    "confidence",
}
"""Kind of word → words, in English, German, French, Spanish and Italian."""

OF_WHAT = ("finger", "proximal")
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
    "force": {"effort": 3.0, "angle": -3.0},
    "torque": {"effort": 3.0, "angle": -3.0},
    "current": {"effort": 3.0, "angle": -3.0},
    "effort": {"effort": 3.0, "angle": -3.0},
    "angle": {"angle": 3.0, "position": 1.0},
    "truth": {"angle": 3.0, "effort": -9.0},
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
    "count": {"count": "count counts cnt tick ticks step steps pulses"},
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
    "K": {"degC": "c °c"},
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

EMPTY_WORDS = frozenset(
    {
        *("observation", "state", "data", "msg", "value", "reading", "id", "present", "actual"),
        *("act", "measured", "ist", "estimate", "estimated", "est", "feedback", "fb"),
    }
)
"""Words that say neither what is measured nor of what."""

_BRACKETS = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")
_LIKE_UNIT = re.compile(r"[^\W\d_][^\d_]{0,11}")
# of single letters only these are units: F_a is a force of a, i_A is in A
_ENDING = re.compile(r"^(?:(.*)[_ ./-])?([A-Za-z°]{2,}|[smgANV°])$")
_TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[^\W\da-zA-Z_]+")
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
    def says_nothing(self) -> bool:
        """Whether neither a word nor a unit is known."""
        return not self.kinds and self.unit is None and not self.unknown_unit


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
        words.extend(compound.groups() if compound else [_singular(word.lower())])
    return words


def _singular(word: str) -> str:
    """Return a known word without the s of its plural, and any other word as it is."""
    known = {*KIND_OF, *EMPTY_WORDS}
    return word[:-1] if word not in known and word.endswith("s") and word[:-1] in known else word


def name_evidence(header: str) -> NameEvidence:
    """Return what the header of a column says."""
    match = _BRACKETS.match(header)
    base, bracket = (match[1], match[2]) if match else (header, "")
    unit, si = _unit(bracket)
    ending = _ENDING.match(base) if unit is None else None
    at_end = SPELLED.get(ending[2].lower()) if ending else None
    if ending and at_end and (ending[1] or at_end[1] == "s"):  # a name that is only ms is a time
        base = ending[1] or base
        unit, si = at_end
    words = words_of(base)
    # a single letter is a symbol at the beginning only, of a recording's column after its topic:
    # F_mcp_f is the force of mcp_f
    topic = base.partition(".")[0] if base.startswith("/") else ""
    first = len(words_of(topic))
    telling = [
        word
        for i, word in enumerate(words)
        if i == first or len(word) > 1 or (word == "m" and words[i + 1 : i + 2] > ["0"])
    ]
    # of each kind once: /actuator_states/actuator_currents is of an actuator as currents are
    kinds = list(dict.fromkeys(KIND_OF[word] for word in telling if word in KIND_OF))
    if "/s" in bracket.replace(" ", ""):
        kinds.append("unused")
    if "index" in kinds and len(words) > 1:  # the finger, not a number of rows
        kinds[kinds.index("index")] = "finger"
    evidence = [EVIDENCE[kind] for kind in kinds]
    if si is not None:
        evidence.append({**NOT_OF_UNIT, **OF_UNIT[si]})
    kept = [
        word
        for i, word in enumerate(words)
        if (len(word) == 1 and i > 0)
        or (
            KIND_OF.get(word, "finger") in OF_WHAT
            and word not in EMPTY_WORDS
            and (len(word) > 1 or len(words) == 1)
        )
    ]
    return NameEvidence(
        {role: sum(each.get(role, 0.0) for each in evidence) for role in ROLES},
        tuple(kinds),
        unit,
        si,
        "_".join(kept),
        tuple(word for word in words if word not in kept and word not in EMPTY_WORDS),
        si != "" and (si is not None or not NO_SCALE & set(words)),
        bracket if _unit(bracket)[0] is None and _LIKE_UNIT.fullmatch(bracket) else "",
    )


def with_families(names: Mapping[str, NameEvidence]) -> dict[str, NameEvidence]:
    """Return what the names of columns say together.

    The subject of an effort or a command is a drive. Of its other columns the one that speaks most
    for a position is its position, and so is that of every other subject which is called alike.
    """
    margins = {h: name.scores["position"] - name.scores["angle"] for h, name in names.items()}
    best = {header: max(ROLES, key=lambda r: name.scores[r]) for header, name in names.items()}
    drives = {
        name.subject
        for header, name in names.items()
        if best[header] in ("effort", "command") and name.scores[best[header]] >= LIKELY
    }
    movers = [
        header
        for header, name in names.items()
        if best[header] in ("position", "angle") or name.says_nothing
    ]
    are_named = any(margins[header] >= LIKELY for header in movers)
    quantities = set[tuple[tuple[str, ...], str | None]]()
    for drive in drives:
        family = [header for header in movers if names[header].subject == drive]
        chosen = max(family, key=lambda header: margins[header], default=None)
        # where other columns are called positions, one that is called an angle is a joint's
        if chosen is not None and not (are_named and margins[chosen] <= -LIKELY):
            quantities.add((names[chosen].quantity, names[chosen].unit))
    result = dict(names)
    for header in movers:
        name = names[header]
        if (name.quantity, name.unit) in quantities and margins[header] < SURE:
            result[header] = _as(name, "position")
    angles = [header for header in movers if result[header].scores["angle"] >= LIKELY]
    references = [header for header in angles if "reference" in names[header].kinds]
    for header in references if len(angles) > len(references) else ():
        # where other columns are joints, this is what a drive should do
        if names[header].subject and names[header].subject in drives:
            result[header] = _as(names[header], "command")
    return result


def _as(name: NameEvidence, role: Role) -> NameEvidence:
    """Return what a name says with its family, which says its role."""
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

"""What the name of a column says: words in five languages, and units behind it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal
from unicodedata import combining, normalize

from distal.errors import UnitError
from distal.units import unit_factor

Role = Literal["time", "position", "effort", "angle", "command", "other"]
"""Position and effort are a drive's, an angle is a joint's reference."""

CLEAR_WORD = 3.0
"""How much a clear word speaks for a role, as a logarithm of odds [1]. Source: judgement."""

WEAK_WORD = 1.2
"""The same of a weak word [1]. Source: judgement."""

CLEAR: Mapping[Role, str] = {
    "time": "t time zeit temps tiempo tempo stamp timestamp clock stempel secs seconds millis",
    "position": "enc encoder ticks tick counts count disp displacement weg recorrido x phi "
    "posmotor motorpos servopos stroke travel hub course carrera corsa",
    "effort": "force kraft fuerza forza effort load loadcell tension zug cur curr current strom "
    "courant corriente corrente torque drehmoment couple coppia tau f u lc fsr amps traction "
    "tensione",
    "angle": "theta angle winkel angulo angolo truth true camera cam kamera camara mocap vicon "
    "optitrack fiducial aruco goniometer gonio joint gelenk articulation articulacion giunto tag",
    "command": "cmd command goal target setpoint sp soll sollwert consigne consigna comando "
    "desired befehl action",
    "other": "temp temperature temperatur volt voltage spannung voltaje pwm duty battery index idx "
    "frame seq row id status state mode flag error err speed vel velocity geschwindigkeit vitesse "
    "velocidad velocita omega acc accel gyro humidity pressure rpm unnamed checksum",
}
"""Role → words that name it, in English, German, French, Spanish and Italian."""

WEAK: Mapping[Role, str] = {
    "time": "s sec ms us ns dt",
    "position": "pos position posicion posizione stellung motor servo drive actuator slider spool "
    "m antrieb moteur motore tendon cable seil cavo",
    "effort": "i moment par fx fz n ma cell zelle",
    "angle": "q ref reference mcp pip dip cmc wrist elbow finger thumb index knee yaw pitch roll "
    "jaw hand poignet doigt muneca dedo polso dito handgelenk daumen ist measured flex flexion "
    "abd abduction tilt inclination bend bending orientation deflection heading neck shoulder "
    "hip ankle toe trunk th knuckle neigung beugung inclinaison inclinacion inclinazione",
    "command": "des des_ ziel cible objetivo obiettivo",
    "other": "z quality conf confidence count_rows",
}

SHORTEST_PART = 3
"""Number of letters of the shortest word that a compound is made of. Source: judgement."""

GREEK = {"θ": "theta", "φ": "phi", "ϕ": "phi", "τ": "tau", "ω": "omega", "α": "alpha", "β": "beta"}
"""Letters of symbols, as words."""

RATES = frozenset(
    [
        "vel",
        "velocity",
        "speed",
        "geschwindigkeit",
        "vitesse",
        "velocidad",
        "velocita",
        "omega",
        "acc",
        "accel",
        "dot",
        "rate",
    ]
)
"""A column with one of these words is a rate of change, whatever it is a rate of."""

COMMANDS = frozenset(CLEAR["command"].split()) | {"des"}
"""A column with one of these words is a command, also where it names a motor or a joint."""

ROLE_WORDS = frozenset(
    word
    for group in (CLEAR, WEAK)
    for role, text in group.items()
    for word in text.split()
    if not (group is WEAK and role == "angle")
)
"""Words that say what is measured, not of what."""

WORDS = frozenset(
    word for group in (CLEAR, WEAK) for text in group.values() for word in text.split()
)
"""All words of these tables."""

EMPTY_WORDS = frozenset(["observation", "state", "states", "data", "msg", "value", "reading"])
"""Words that say neither what is measured nor of what."""

DRIVES = frozenset(
    [
        "motor",
        "servo",
        "drive",
        "actuator",
        "slider",
        "spool",
        "antrieb",
        "moteur",
        "motore",
        "tendon",
        "cable",
        "seil",
        "cavo",
        "m",
        "enc",
        "encoder",
        "actuador",
        "attuatore",
        "prox",
        "proximal",
    ]
)
"""A column of these is a drive's, also where it is called an angle."""

JOINTS = frozenset(["joint", "gelenk", "articulation", "articulacion", "giunto"])
"""A column of these is a joint's, also where it is called a position."""

UNITS: Mapping[str, tuple[str, str]] = {
    **{name: (name, "s") for name in ("s", "ms", "us", "ns")},
    "sec": ("s", "s"),
    "secs": ("s", "s"),
    "seconds": ("s", "s"),
    "millis": ("ms", "s"),
    **{name: (name, "rad") for name in ("rad", "deg", "mrad")},
    "degrees": ("deg", "rad"),
    "degree": ("deg", "rad"),
    "grad": ("deg", "rad"),
    "°": ("deg", "rad"),
    "radians": ("rad", "rad"),
    "rads": ("rad", "rad"),
    **{name: (name, "m") for name in ("m", "mm", "cm", "um")},
    "n": ("N", "N"),
    "mn": ("mN", "N"),
    "newton": ("N", "N"),
    "lbf": ("lbf", "N"),
    "gf": ("gf", "N"),
    "kgf": ("kgf", "N"),
    "g": ("gf", "N"),
    "kg": ("kgf", "N"),
    "nm": ("N m", "N m"),
    "mnm": ("mN m", "N m"),
    "ncm": ("N cm", "N m"),
    "a": ("A", "A"),
    "ma": ("mA", "A"),
    "amps": ("A", "A"),
    "ticks": ("count", "count"),
    "tick": ("count", "count"),
    "counts": ("count", "count"),
    "count": ("count", "count"),
    "cnt": ("count", "count"),
    "nmm": ("N mm", "N m"),
    "gram": ("gf", "N"),
    "grams": ("gf", "N"),
    "lb": ("lbf", "N"),
    "lbs": ("lbf", "N"),
    "kp": ("kgf", "N"),
    "kgcm": ("kgf cm", "N m"),
    "step": ("count", "count"),
    "steps": ("count", "count"),
    "pulses": ("count", "count"),
    "min": ("min", "s"),
    "v": ("V", "V"),
    "mv": ("mV", "V"),
    "c": ("degC", "K"),
    "°c": ("degC", "K"),
    "%": ("%", ""),
    "pct": ("%", ""),
    "percent": ("%", ""),
}
"""How units are written in headers → the unit, and the SI unit of its dimension."""

OF_UNIT: Mapping[str, tuple[Role, ...]] = {
    "s": ("time",),
    "rad": ("position", "angle", "command"),
    "m": ("position", "command"),
    "count": ("position", "command"),
    "N": ("effort",),
    "N m": ("effort",),
    "A": ("effort",),
    "V": ("other",),
    "K": ("other",),
    "": ("other", "effort"),
}
"""SI unit → the roles that a column in it can have."""

OF_FIRST_ROLE = 2.5
"""How much a unit of lengths or counts speaks for a drive's position, beside a command. Source:
judgement.
"""

LETTERS = "smgAN"
"""Units of one letter as they stand at the end of a name: `F_a` is a force of a, `i_A` is in A."""

_BRACKETS = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")
_LIKE_UNIT = re.compile(r"[^\W\d_][^\d_]{0,11}")
_ENDING = re.compile(r"^(?:(.*)[_ ./-])?([A-Za-z°]+)$")
_TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+|[^\W\da-zA-Z_]+")


@dataclass(frozen=True)
class NameEvidence:
    """What a name says: how much it speaks for each role, its unit, and whose column it is.

    Args:
        scores: role → logarithm of odds.
        unit: as a rig file has it, None where the name has none.
        si: SI unit of its dimension.
        subject: what is left of the name without these words: which drive or joint.
        unknown_unit: what stands in brackets where a unit stands, and is none that is known.
    """

    scores: Mapping[Role, float]
    unit: str | None
    si: str | None
    subject: str
    unknown_unit: str = ""


def words_of(name: str) -> list[str]:
    """Return the words of a name in lower case: `posMotor_2` gives pos, motor, 2; `Motorwinkel`
    gives motor, winkel.
    """
    for letter, word in GREEK.items():
        name = name.replace(letter, f" {word} ")
    plain = "".join(letter for letter in normalize("NFKD", name) if not combining(letter))
    return [part for word in _TOKEN.findall(plain) for part in _without_compounds(word.lower())]


def _without_compounds(word: str) -> tuple[str, ...]:
    """Return the two words that a word is made of, or itself."""
    if word in WORDS:
        return (word,)
    for i in range(SHORTEST_PART, len(word) - SHORTEST_PART + 1):
        parts = word[:i], word[i:]
        if all(part in WORDS for part in parts):
            return parts
    return (word,)


def name_evidence(header: str) -> NameEvidence:
    """Return what the header of a column says."""
    match = _BRACKETS.match(header)
    base, bracket = (match[1], match[2]) if match else (header, "")
    unit = _unit(bracket)
    ending = None if unit else _ENDING.match(base)
    at_end = None if ending is None else _unit_at_end(ending[1] or "", ending[2])
    if ending is not None and at_end is not None:
        base = ending[1] or base
    words = words_of(base)
    found = unit or at_end
    # a single letter is a symbol at the beginning only, of a recording's column after its topic:
    # F_mcp_f is the force of mcp_f
    topic = base.partition(".")[0] if base.startswith("/") else ""
    first = len(words_of(topic))
    telling = [word for i, word in enumerate(words) if i == first or len(word) > 1]
    scores = dict.fromkeys(CLEAR, 0.0)
    for role in CLEAR:
        clear = sum(word in CLEAR[role].split() for word in telling)
        weak = sum(word in WEAK[role].split() for word in telling)
        scores[role] = CLEAR_WORD * min(clear, 2) + WEAK_WORD * min(weak, 2)
    if scores["effort"] and any(word in ("true", "truth") for word in words):
        # a reference torque is not read by a motor
        scores["effort"] = scores["angle"] = 0.0
        scores["other"] += 2.0 * CLEAR_WORD
    if any(word in DRIVES for word in telling):
        scores["position"] += scores["angle"]
        scores["angle"] = 0.0
    elif any(word in JOINTS for word in telling):
        scores["angle"] += scores["position"]
        scores["position"] = 0.0
    if any(word in RATES for word in telling) or "/s" in bracket.replace(" ", ""):
        scores = dict.fromkeys(scores, 0.0) | {"other": 2.0 * CLEAR_WORD}
    elif any(word in COMMANDS for word in telling):
        scores = dict.fromkeys(scores, 0.0) | {"command": 2.0 * CLEAR_WORD}
    if found is not None:
        for role in scores:
            if role == OF_UNIT[found[1]][0]:
                scores[role] += OF_FIRST_ROLE if found[1] in ("m", "count") else 1.0
            elif role in OF_UNIT[found[1]]:
                scores[role] += 1.0
            else:
                scores[role] -= 2.0 * CLEAR_WORD if unit else CLEAR_WORD
    kept = [
        word
        for i, word in enumerate(words)
        if word not in ROLE_WORDS | EMPTY_WORDS or (i > 0 and len(word) == 1)
    ]
    return NameEvidence(
        scores,
        found[0] if found else None,
        found[1] if found else None,
        "_".join(kept),
        bracket if unit is None and _LIKE_UNIT.fullmatch(bracket) else "",
    )


def _unit_at_end(name: str, ending: str) -> tuple[str, str] | None:
    """Return the unit at the end of a name; a name that is nothing but ms is a time."""
    if not name and ending not in ("ms", "us", "ns", "sec", "seconds", "millis"):
        return None
    is_symbol = len(ending) == 1 and ending not in LETTERS
    return None if is_symbol else UNITS.get(ending.lower())


def _unit(text: str) -> tuple[str, str] | None:
    """Return a unit in brackets as a rig file has it, and the SI unit of its dimension."""
    if not text:
        return None
    plain = re.sub(r"[\s·*.]+", "", text).lower()
    if plain in UNITS:
        return UNITS[plain]
    for si in ("s", "rad", "m", "N", "N m", "A"):
        try:
            unit_factor(text, si)
        except UnitError:
            continue
        return text, si
    return None

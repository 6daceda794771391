"""Rig files: reading them from TOML, the rigs that come with distal, and writing one for a rig that
is made from other files, with comments at the guessed values.
"""

from __future__ import annotations

import re
import tomllib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from distal.errors import DistalError, DistalWarning, RigError, did_you_mean
from distal.rig.learned import with_arrays
from distal.rig.rig import Rig
from distal.rig.validation import parse_assignment, set_value, validated
from distal.rig.values_with_stds import Raw

if TYPE_CHECKING:
    from tomlkit.items import Item

RIGS = "distal.rig"
"""Package with the library of rigs."""


def shipped_in(package: str) -> tuple[str, ...]:
    """Return the names of the descriptions in the library of a package."""
    files = resources.files(package).joinpath("library").iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def description_path(name: str | Path, package: str) -> Path:
    """Return the file of a description: in the library of a package, which comes before a path of
    the same name.
    """
    if str(name) in shipped_in(package):
        return Path(str(resources.files(package) / "library" / f"{name}.toml"))
    return Path(name)


def description_text(name: str | Path, package: str, kind: str, error: type[DistalError]) -> str:
    """Return the text of a shipped description or of the file at a path, or raise `error`; `kind`
    says in messages what is described.
    """
    path = description_path(name, package)
    if path.suffix != ".toml" and not path.exists():
        raise error(
            f"unknown {kind} '{name}'{did_you_mean(str(name), shipped_in(package))}; or give the "
            "path of a .toml file"
        )
    return read_text(path, error)


def shipped_rigs() -> tuple[str, ...]:
    """Return the names of the rigs that come with distal."""
    return shipped_in(RIGS)


def read_text(path: Path, error: type[DistalError]) -> str:
    """Return the text of a file (UTF-8), or raise `error` with the reason in plain words."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{path}: not a text file (UTF-8 is expected)") from None
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror or problem})") from None


def parse_toml(text: str, source: str, error: type[DistalError]) -> Raw:
    """Return the tables of a TOML text, or raise `error` naming the source, line and column."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as problem:
        raise error(f"{source}: not valid TOML: {str(problem) or 'nested too deeply'}") from None


def as_rig(rig: Rig | str | Path) -> Rig:
    """Return a `Rig` as it is, or load one by its shipped name or path; for errors see
    `load_rig`.
    """
    return rig if isinstance(rig, Rig) else load_rig(rig)


def load_rig(name: str | Path, assignments: Sequence[str] = ()) -> Rig:
    """Load a rig by name (see `shipped_rigs`) or from a TOML file, with assignments ``path=value``
    as by ``--set``.

    Raises:
        RigError: the rig is unknown, cannot be read, or its description is wrong.
    """
    _, changed, rig = _changed(name, assignments)
    moved = [path for path, _ in changed if path.split(".")[0] in ("joints", "drives", "tendons")]
    if moved and rig.map is not None and rig.map.filter:
        is_torque = any(path.split(".")[2:3] == ["external_torque"] for path in moved)
        torque = "; declare external_torque.std in the rig file before the fit" if is_torque else ""
        warnings.warn(
            f"{name}: [map] was learned with other numbers than {', '.join(moved)} now "
            "has: "
            f"fit again, or remove it{torque}",
            DistalWarning,
            stacklevel=2,
        )
    return rig


def edited_text(name: str | Path, assignments: Sequence[str] = ()) -> str:
    """Return the text of a rig file with some values replaced, as by `load_rig`; its comments
    stay.
    """
    text, changed, _ = _changed(name, assignments)
    if not changed:
        return text
    import tomlkit

    document = tomlkit.parse(text)
    for path, value in changed:
        set_value(document, path, value, RigError)
    return tomlkit.dumps(document)


def _changed(
    name: str | Path, assignments: Sequence[str]
) -> tuple[str, list[tuple[str, object]], Rig]:
    """Return the text of a rig file, the paths and values of some assignments, and the rig that
    has these values.
    """
    text = description_text(name, RIGS, "rig", RigError)
    source = str(name)
    raw = parse_toml(text, source, RigError)
    changed = [parse_assignment(assignment, RigError) for assignment in assignments]
    for path, value in changed:
        set_value(raw, path, value, RigError)
    folder = description_path(name, RIGS).parent
    return text, changed, build_rig(with_arrays(raw, source, folder), source)


def build_rig(raw: Mapping[str, object], source: str) -> Rig:
    """Check a raw description and return the rig, or raise a `RigError`; `source` names it in
    messages.
    """
    return validated(Rig, raw, source, RigError)


@dataclass(frozen=True)
class Guess:
    """A value that the files do not give and that is guessed; `of` says in words what it is a value
    of. It has a wide std where it can have one.
    """

    value: object
    of: str


@dataclass(frozen=True)
class Imported:
    """A rig that is made from other files.

    Args:
        text: its rig file, with a comment at each guessed value.
        notes: what was left out, held or fitted, a line each.
        missing: what the files do not say, in words.
    """

    rig: Rig
    text: str
    notes: tuple[str, ...]
    missing: tuple[str, ...]

    @staticmethod
    def of(raw: Mapping[str, object], title: str, source: str, notes: Sequence[str]) -> Imported:
        """Return the rig of a raw description that has guesses in it; comments say that these are
        not in the `source`.
        """
        text = written(raw, source)
        rig = build_rig(parse_toml(text, title, RigError), title)
        missing = dict.fromkeys(guess.of for guess in guesses(raw))
        return Imported(rig, text, tuple(notes), tuple(missing))


def name_of(name: str, otherwise: str) -> str:
    """Return a name in the form that a rig file allows; `otherwise` where no character of it is
    left.
    """
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_-") or otherwise
    name = name if re.match(r"[A-Za-z_]", name) else f"_{name}"
    return (f"{name}_" if name in ("std", "dot", "base") or name.endswith("_std") else name)[:64]


def guesses(raw: object) -> Iterator[Guess]:
    """Yield the guesses in a raw description."""
    if isinstance(raw, Guess):
        yield raw
    elif isinstance(raw, (Mapping, list)):
        for value in raw.values() if isinstance(raw, Mapping) else raw:
            yield from guesses(value)


def written(raw: Mapping[str, object], source: str) -> str:
    """Return the TOML text of a raw description, each guess with a comment that it is not in the
    `source`.
    """
    import tomlkit

    return tomlkit.dumps(
        {
            key: [_commented(row, source) for row in part]
            if isinstance(part, list)
            else _commented(part, source)
            for key, part in raw.items()
        }
    )


def _commented(part: object, source: str) -> object:
    """Return a table whose values are in one line each, with comments; what is no table stays."""
    from tomlkit.items import Array

    if not isinstance(part, dict):
        return part
    lines = {key: _inline(value) for key, value in part.items()}
    for key, line in lines.items():
        if isinstance(line, Array) and key == "crossings":
            line.multiline(True)
        guessed = ", ".join(dict.fromkeys(guess.of for guess in guesses(part[key])))
        if guessed:
            line.comment(f"not in the {source}: {guessed}")
    return lines


def _inline(part: object) -> Item:
    """Return a part in one line, each guess in it replaced by its value."""
    import tomlkit

    if isinstance(part, Guess):
        return _inline(part.value)
    if isinstance(part, dict):
        table = tomlkit.inline_table()
        table.update({key: _inline(inner) for key, inner in part.items()})
        return table
    if isinstance(part, list):
        array = tomlkit.array()
        array.extend(map(_inline, part))
        return array
    return tomlkit.item(part)

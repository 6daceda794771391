"""The fitted rig as a file: values in their old positions, comments kept, and at the head an
account of the fit.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from pathlib import Path

from distal.errors import DistalWarning, OutputError, RigError
from distal.logs import write_together
from distal.rig import Rig, arrays_file, as_table, build_rig, parse_toml, set_value

MARK = "# Fitted by `distal "
"""The first words of a fitted file; by them the head of an earlier fit is found and replaced."""


LEARNED = ("map", "left_out")
"""Tables that a fit writes; one that this fit did not learn is removed, since it belongs
to an earlier fit.
"""


def fitted_text(
    rig: Rig,
    start: Rig,
    values: Mapping[str, object],
    head: str,
    text: str | None,
    table: Mapping[str, object] | None = None,
) -> str:
    """Return the TOML of a fitted rig, which reads as exactly this rig.

    If values in the old text would not read as this rig, the file is written anew, with a warning
    and without comments, so that no result is lost.

    Args:
        rig: the fitted rig.
        start: the original rig.
        values: path → value of what changed.
        head: comment at the head of the file, which begins with `MARK`.
        text: TOML of the original rig, whose comments stay; None writes the file anew.
        table: the table `[map]`, whose numbers are in the file that it names.

    Raises:
        RigError: the text is not that of the original rig.
        OutputError: the rig cannot be written so that it reads as the same.
    """
    rig = rig.model_copy(update={"map": None})
    if text is None:
        return head + _anew(rig, table)
    if _read(text).bare() != start.bare():
        raise RigError("the text is not that of the rig that was fitted; save without it")
    try:
        written = head + _put_into(text, rig, {**values, **({"map": table} if table else {})})
        agrees = _read(written) == rig
    except RigError:
        agrees = False
    if agrees:
        return written
    warnings.warn(
        "the fitted values do not fit into the text of the rig file: the file is written anew, "
        "without its comments",
        DistalWarning,
        stacklevel=2,
    )
    return head + _anew(rig, table)


def write_fitted(
    path: str | Path,
    rig: Rig,
    start: Rig,
    values: Mapping[str, object],
    head: str,
    text: str | None,
) -> None:
    """Write a fitted rig file, and beside it the numbers of its maps: both or none; see
    `fitted_text` for the arguments.

    Raises:
        OutputError: a file cannot be written; what stood there is unchanged.
    """
    files: dict[Path, bytes | str] = {}
    table = None
    if rig.map is not None:
        table, content = as_table(rig.map, path)
        files[arrays_file(path)] = content
    files[Path(path)] = fitted_text(rig, start, values, head, text, table)
    write_together(files)


def _put_into(text: str, rig: Rig, values: Mapping[str, object]) -> str:
    import tomlkit

    before = _without_old_head(text)
    document = tomlkit.parse(before)
    for learned in LEARNED:
        if learned in document and (learned == "map" or not getattr(rig, learned)):
            del document[learned]
    for path, value in values.items():
        set_value(document, path, value, RigError)
    return _without_guesses(tomlkit.dumps(document), before)


GUESSED = re.compile(r" # (not in the \w+: .*)$")
"""Comment of a draft beside a value that is a guess (`distal.rig.Guess`)."""


def _without_guesses(text: str, before: str) -> str:
    """Return a text in which no line that was changed calls its values guesses: that of one value
    loses its comment, one of several says that a part of them are.
    """
    old = set(before.split("\n"))
    lines = []
    for line in text.split("\n"):
        if line not in old:
            line = GUESSED.sub(r" # partly \1" if line.count("{") > 1 else "", line)
        lines.append(line)
    return "\n".join(lines)


def _anew(rig: Rig, table: Mapping[str, object] | None) -> str:
    """Return the TOML of a rig without maps, written anew, with the table `[map]`.

    Raises:
        OutputError: it does not read as this rig.
    """
    import tomlkit

    described = plain_value(rig.model_dump(exclude_defaults=True))
    written = tomlkit.dumps({**described, **({"map": plain_value(table)} if table else {})})
    if _read(written) != rig:
        raise OutputError(
            f"{rig.name}: the fitted rig cannot be written so that it reads as the same"
        )
    return written


def _read(text: str) -> Rig:
    """Return the rig of a text, without its maps, whose numbers are elsewhere."""
    raw = parse_toml(text, "fitted rig", RigError)
    return build_rig({key: value for key, value in raw.items() if key != "map"}, "fitted rig")


def plain_value(raw: Mapping[str, object]) -> dict[str, object]:
    """Return a description as TOML can hold it: without empty values, and without the SI tags that
    reading finds again.
    """
    return {key: _plain(value) for key, value in raw.items() if value is not None and key != "si"}


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return plain_value(value)
    return [_plain(part) for part in value] if isinstance(value, (list, tuple)) else value


def _without_old_head(text: str) -> str:
    """Return the text without the head of an earlier fit."""
    lines = text.split("\n")
    if not lines or not lines[0].startswith(MARK):
        return text
    first = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    return "\n".join(lines[first:]).lstrip("\n")

"""The fitted rig as a file: values in their old positions, comments kept, and at the head an
account of the fit.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

from distal.errors import DistalWarning, OutputError, RigError
from distal.rig import Rig, build_rig, parse_toml, set_value

MARK = "# Fitted by `distal "
"""The first words of a fitted file; by them the head of an earlier fit is found and replaced."""


LEARNED = ("affine", "discrepancy", "contact", "free_motion", "provisional")
"""Tables and keys that a fit writes; one that this fit did not learn is removed, since it belongs
to an earlier fit.
"""


def fitted_text(
    rig: Rig, start: Rig, values: Mapping[str, object], head: str, text: str | None
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

    Raises:
        RigError: the text is not that of the original rig.
        OutputError: the rig cannot be written so that it reads as the same.
    """
    if text is None:
        return head + _anew(rig)
    if _read(text).bare() != start.bare():
        raise RigError("the text is not that of the rig that was fitted; save without it")
    try:
        written = head + _put_into(text, rig, values)
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
    return head + _anew(rig)


def _put_into(text: str, rig: Rig, values: Mapping[str, object]) -> str:
    import tomlkit

    document = tomlkit.parse(_without_old_head(text))
    for learned in LEARNED:
        if not getattr(rig, learned) and learned in document:
            del document[learned]
    for path, value in values.items():
        set_value(document, path, value, RigError)
    return tomlkit.dumps(document)


def _anew(rig: Rig) -> str:
    """Return the TOML of a rig, written anew.

    Raises:
        OutputError: it does not read as this rig.
    """
    import tomlkit

    written = tomlkit.dumps(plain_value(rig.model_dump(exclude_defaults=True)))
    if _read(written) != rig:
        raise OutputError(
            f"{rig.name}: the fitted rig cannot be written so that it reads as the same",
            {Path("fitted.toml"): written},
        )
    return written


def _read(text: str) -> Rig:
    return build_rig(parse_toml(text, "fitted rig", RigError), "fitted rig")


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

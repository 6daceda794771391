"""The fitted rig as a file: values in place, comments kept, and an account of the fit at its
head.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

from distal.errors import DistalWarning, OutputError, RigError
from distal.rig import Rig, build_rig, parse_toml, set_value

MARK = "# Fitted by `distal "
"""How the head of a fitted file begins, by which that of an earlier fit is found and replaced."""


LEARNED = ("affine", "discrepancy", "contact", "free_motion", "provisional")
"""Tables and keys that a fit writes; one that it did not learn belongs to an earlier fit."""


def fitted_text(
    rig: Rig, start: Rig, values: Mapping[str, object], head: str, text: str | None
) -> str:
    """Return the TOML of a fitted rig, which reads as exactly this rig.

    The `values` by path that changed from the `start` as it came are put into a `text`, so that
    its comments stay; None writes the description anew. First stands a comment `head`, which begins
    with `MARK`. Where the text with the values in it reads as another rig, the description is
    written anew with a warning: no result is lost for a comment.

    Raises:
        RigError: the text is not that of the rig that was fitted.
        OutputError: the rig cannot be written.
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
    """Return the TOML of a rig as it is.

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
    """Return a description as TOML can hold it: no empty values, no SI tags that are found again on
    reading.
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

"""The fitted rig as a file: values in place, comments kept, and an account of the fit at its
head.
"""

from __future__ import annotations

from collections.abc import Mapping

from distal.errors import RigError
from distal.rig import Rig, build_rig, parse_toml, set_value

MARK = "# Fitted by `distal "
"""How the head of a fitted file begins, by which that of an earlier fit is found and replaced."""


def fitted_text(
    rig: Rig, start: Rig, values: Mapping[str, object], head: str, text: str | None
) -> str:
    """Return the TOML of a fitted rig, with the `values` by path that changed from the `start` as
    it came.

    They are put into a `text`, None for the description written anew; first stands a comment
    `head`, which begins with `MARK`.

    Raises:
        RigError: the text is not the rig that was fitted.
    """
    import tomlkit

    source = (
        text if text is not None else tomlkit.dumps(plain(start.model_dump(exclude_defaults=True)))
    )
    document = tomlkit.parse(_without_old_head(source))
    for learned in ("affine", "discrepancy", "contact"):
        if getattr(rig, learned) is None and learned in document:
            del document[learned]  # it was learned with other numbers
    for path, value in values.items():
        set_value(document, path, value, RigError)
    written = head + tomlkit.dumps(document)
    if build_rig(parse_toml(written, "fitted rig", RigError), "fitted rig") != rig:
        raise RigError("the text is not that of the rig that was fitted; save without it")
    return written


def plain(raw: Mapping[str, object]) -> dict[str, object]:
    """Return a description as TOML can hold it: no empty values, no SI tags that are found again on
    reading.
    """
    return {key: _plain(value) for key, value in raw.items() if value is not None and key != "si"}


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return plain(value)
    return [_plain(part) for part in value] if isinstance(value, (list, tuple)) else value


def _without_old_head(text: str) -> str:
    """Return the text without the head of an earlier fit."""
    lines = text.split("\n")
    if not lines or not lines[0].startswith(MARK):
        return text
    first = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    return "\n".join(lines[first:]).lstrip("\n")

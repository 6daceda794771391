"""The fitted rig as a file: values in place, comments kept, and where each value came from at its head."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from distal.errors import RigError
from distal.identification.result import Fitted
from distal.logs import shown
from distal.rig import Rig, build_rig, number, parse_toml, set_value

if TYPE_CHECKING:
    from distal.identification.result import Fit

DIGITS = 7
"""Significant digits of a value in a file: far more than any log tells."""

SMALLEST_STD = 0.002
"""A std in a fitted file is at least this share of its value: no two days are more alike."""


def assignments(fitted: Sequence[Fitted], start: Rig) -> dict[str, Any]:
    """Return path → value, with its std where it had one, of what the logs told.

    Args:
        fitted: every free number.
        start: the description as it came.
    """
    changed: dict[str, Any] = {}
    for part in fitted:
        if not part.told:
            continue
        for path, value in zip(part.paths, part.values):
            before = number(start, path)
            rounded = float(f"{value:.{DIGITS}g}")
            if only_grows(path, start):
                # what these logs did not need, the next may: a filter that trusts its model wholly is not honest
                rounded = max(rounded, before.value)
            if not before.is_parameter or before.std == 0.0:
                changed[path] = rounded
                continue
            share = abs(value / part.value) if part.value else 1.0
            std = max(part.error * share, SMALLEST_STD * abs(value))
            changed[path] = {"value": rounded, "std": float(f"{std:.3g}")}
    return changed


def only_grows(path: str, rig: Rig) -> bool:
    """Return whether a noise is never written smaller than it was: what the model does not know, and displacements'.

    Args:
        path: of the number.
        rig: the description.
    """
    places = [f"sensors.{i}.noise" for i, sensor in enumerate(rig.sensors) if sensor.measures == "position"]
    return path.endswith(".unmodelled") or path in places


def fitted_text(fit: Fit, text: str | None) -> str:
    """Return the TOML of a fitted rig.

    Args:
        fit: the outcome.
        text: TOML that the values are put into; None writes the description anew.

    Raises:
        RigError: the text is not the rig that was fitted.
    """
    import tomlkit

    source = text if text is not None else tomlkit.dumps(plain(fit.start.model_dump(exclude_defaults=True)))
    document = tomlkit.parse(_without_old_head(source))
    for path, value in {**assignments(fit.fitted, fit.start), **fit.curves}.items():
        set_value(document, path, value, RigError)
    written = head(fit) + tomlkit.dumps(document)
    if build_rig(parse_toml(written, "fitted rig", RigError), "fitted rig") != fit.rig:
        raise RigError("the text is not that of the rig that was fitted; save without it")
    return written


def plain(raw: Any) -> Any:
    """Return a description as TOML can hold it: no empty values, no SI tags that are found again on reading.

    Args:
        raw: as dumped.
    """
    if isinstance(raw, Mapping):
        return {key: plain(value) for key, value in raw.items() if value is not None and key != "si"}
    if isinstance(raw, (list, tuple)):
        return [plain(value) for value in raw]
    return raw


MARK = "# Fitted by `distal fit`"


def _without_old_head(text: str) -> str:
    """Return the text without the head of an earlier fit."""
    lines = text.split("\n")
    if not lines or not lines[0].startswith(MARK):
        return text
    first = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    return "\n".join(lines[first:]).lstrip("\n")


def head(fit: Fit) -> str:
    """Return the comment at the head of a fitted file: what it was fitted to, and where each value came from.

    Args:
        fit: the outcome.
    """
    names = ", ".join(shown(name.rsplit("/", 1)[-1]) for name in fit.logs)
    use = "" if fit.homing is None else f", as used with a reference for the first {fit.homing:g} s"
    lines = [
        f"{MARK} to {len(fit.logs)} log{'s' if len(fit.logs) > 1 else ''} ({fit.duration:.0f} s){use}:",
        f"# {names}",
    ]
    if fit.interrupted:
        lines.append("# The search was interrupted: these are the best values so far.")
    rows = [("number", "value", "± standard error", "started at", "from")]
    for part in fit.fitted:
        error = f"{part.error:.2g}" if np.isfinite(part.error) else "–"
        prior = "" if np.isnan(part.prior_std) else f" ± {part.prior_std:.3g}"
        rows.append((part.name, f"{part.value:.5g} {part.si}".strip(), error, f"{part.start:.5g}{prior}", part.origin))
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    lines += ["#   " + "  ".join([*(row[i].ljust(widths[i]) for i in range(4)), row[4]]) for row in rows]
    if fit.curves:
        lines.append(
            "# Learned too: the systematic curves of the position sensors (curve), and what linearity is left."
        )
    lines += [f"# These logs tell {line}." for line in fit.combinations]
    return "\n".join(lines) + "\n\n"

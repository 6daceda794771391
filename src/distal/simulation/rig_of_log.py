"""The file beside a simulated log that names its rig, and what its scenario changed in the rig."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from distal.errors import RigError
from distal.rig import (
    Rig,
    description_path,
    load_rig,
    parse_assignment,
    parse_toml,
    read_text,
    shipped_rigs,
)

BESIDE = ".rig.toml"
"""What follows the name of a log in the name of the file. Source: definition."""

OF_ALL = f"all{BESIDE}"
"""Name of the file of several logs in a folder. Source: definition."""


def rig_beside(log: Path, several: bool = False) -> Path:
    """Return the path of the file beside a log, or of that of several logs in a folder."""
    return log / OF_ALL if several else log.with_name(log.name + BESIDE)


def text_beside(rig: str, values: Mapping[str, object]) -> str:
    """Return the text of the file.

    Args:
        rig: name of a shipped rig, or a path.
        values: path → value of what the scenario changed in it.
    """
    import tomlkit

    name = rig if rig in shipped_rigs() else str(description_path(rig, "distal.rig").resolve())
    head = "# What the log was simulated with, as `distal estimate` reads it.\n\n"
    return head + tomlkit.dumps({"rig": name, "set": dict(values)})


def rig_of_logs(
    logs: Iterable[object], asked: str | None, assignments: Iterable[str] = ()
) -> tuple[Rig, tuple[str, ...]]:
    """Return the rig by which logs are read, and the paths in it that their scenario changed.

    That is the rig asked for, else the one that is named beside the logs. A shipped rig does not
    know of a scenario. Where it has the joints and drives of the rig beside the logs, it gets what
    the scenario changed in that; a rig file stays as it is.

    Args:
        logs: paths, or other sources of logs, which have no file beside them.
        asked: name of a shipped rig, or a path; None: the rig beside the logs.
        assignments: ``path=value`` each, which come last.

    Raises:
        RigError: no rig is asked for and none is beside all of the logs; or a rig is wrong.
    """
    assignments = tuple(assignments)
    found = {_beside(log) for log in logs}
    path = next(iter(found)) if len(found) == 1 else None
    if path is None:
        if asked is None:
            why = (
                "the logs were simulated with different rigs or scenarios"
                if None not in found
                else "only a log that distal simulate wrote has its rig beside it"
            )
            raise RigError(
                f"which rig? --rig takes a shipped rig's name (distal rigs) or a TOML file; {why}"
            )
        return load_rig(asked, assignments), ()
    source = str(path)
    named = parse_toml(read_text(path, RigError), source, RigError)
    rig, values = named.get("rig"), named.get("set", {})
    if not isinstance(rig, str) or not isinstance(values, dict):
        raise RigError(f"{source}: rig is a name or path, and [set] a table of path = value")
    if asked is not None and not (asked in shipped_rigs() and _alike(load_rig(asked), rig)):
        return load_rig(asked, assignments), ()
    later = dict(parse_assignment(text, RigError) for text in assignments)
    return load_rig(asked or rig).with_values({**values, **later}), tuple(values)


def _beside(log: object) -> Path | None:
    """Return the file that belongs to a log, None where there is none."""
    if not isinstance(log, Path):
        return None
    either = (rig_beside(log), rig_beside(log.parent, several=True))
    return next((path for path in either if path.is_file()), None)


def _alike(rig: Rig, named: str) -> bool:
    other = load_rig(named)
    return (rig.joint_names, rig.drive_names) == (other.joint_names, other.drive_names)

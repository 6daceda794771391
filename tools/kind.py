"""Write what logs of a kind of instrument teach into a shipped rig: `python -m tools.kind RIG.toml
HOMING LOG...`.

The shipped da-vinci-grasper comes from `python -m tools.kind
src/distal/rig/library/da-vinci-grasper.toml 3 LOGS`, with all logs of data/da_vinci_grasper and
data/da_vinci_poses of the public repository that docs/how-to/da-vinci.md names.
"""

from __future__ import annotations

import sys
from pathlib import Path

import tomlkit

from distal import learn_affine, learn_discrepancy, load_rig, read_log
from distal.fitting.fitted_file import plain

DIGITS = 6


def rounded(raw: object) -> object:
    """Return numbers with six digits: what is left is far below any spread."""
    if isinstance(raw, float):
        return float(f"{raw:.{DIGITS}g}")
    if isinstance(raw, dict):
        return {key: rounded(value) for key, value in raw.items()}
    if isinstance(raw, (list, tuple)):
        return [rounded(value) for value in raw]
    return raw


def main() -> None:
    """Learn and write."""
    path, homing, logs = Path(sys.argv[1]), float(sys.argv[2]), sys.argv[3:]
    rig = load_rig(path).bare()
    read = [read_log(log, rig) for log in logs]
    found = learn_discrepancy(read, rig, homing=homing)
    print(found.text, *found.notes, sep="\n")
    straight = learn_affine(read, rig, homing=homing)
    print(straight.text, *straight.notes, sep="\n")
    document = tomlkit.parse(path.read_text(encoding="utf-8"))
    for name, table in (("affine", straight.affine), ("discrepancy", found.discrepancy)):
        if name in document:
            del document[name]
        document[name] = rounded(plain(table.model_dump()))
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    load_rig(path)


if __name__ == "__main__":
    main()

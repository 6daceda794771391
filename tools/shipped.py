"""Fit the shipped rig `da-vinci-grasper` anew: `python -m tools.shipped DATA [--out RIG.toml]`.

Other shipped rigs are descriptions; this is the one that logs taught. The folder has
`da_vinci_grasper` (a straight wrist) and `da_vinci_poses` (four others) of the public repository
that docs/how-to/da-vinci.md names. The command `distal fit` finds the parameters on the straight
wrist, from the round numbers of examples/da_vinci/start.toml, as they are used after a homing move
of 3 s; then the correction map and the affine map learn from the logs of all poses.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import tomlkit

from distal import learn_affine, learn_discrepancy, load_rig, read_log
from distal.fitting.fitted_file import plain_value

ROOT = Path(__file__).parents[1]
START = ROOT / "examples" / "da_vinci" / "start.toml"
SHIPPED = ROOT / "src" / "distal" / "rig" / "library" / "da-vinci-grasper.toml"
HOMING = 3.0
"""Length of the homing move [s]."""

CLASSES = r"run_(.)"
"""What tells the kinds of motion apart in a log's name; one is held out as a whole."""

BEFORE = " as one would describe it before any log is fitted: round numbers."
AFTER = (
    ", fitted by `python -m tools.shipped`:\n"
    "# parameters by the logs of a straight wrist, maps by those of all five poses."
)
"""How the comment on what the file is goes on."""

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


def parameters(logs: list[Path]) -> str:
    """Return the rig file that `distal fit` writes for logs of a straight wrist."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "straight.toml"
        words = [*map(str, logs), "--rig", str(START), "--homing", f"{HOMING:g}s"]
        options = ["--units", CLASSES, "--out", str(out)]
        subprocess.run([sys.executable, "-m", "distal", "fit", *words, *options], check=True)
        return out.read_text(encoding="utf-8")


def introduced(text: str) -> str:
    """Return the rig file with what the fitted one is, in place of what the round numbers were."""
    text = text.replace(BEFORE, AFTER).replace(", before fitting", "")
    of_maps = re.compile(r"^# (affine|discrepancy): .*\n", re.M)
    return of_maps.sub("", text)


def with_maps(path: Path, logs: list[Path]) -> None:
    """Put the maps that logs of all poses teach into a rig file."""
    rig = load_rig(path).bare()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = [read_log(log, rig) for log in logs]
        maps = [learn(read, rig, homing=HOMING) for learn in (learn_affine, learn_discrepancy)]
    document = tomlkit.parse(path.read_text(encoding="utf-8"))
    for found in maps:
        print(found.text, *found.notes, sep="\n")
        if found.table in document:
            del document[found.table]
        document[found.table] = rounded(plain_value(found.learned.model_dump()))
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    load_rig(path)


def main() -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(prog="python -m tools.shipped", description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, default=SHIPPED)
    asked = parser.parse_args()
    straight = sorted((asked.data / "da_vinci_grasper").glob("run_*.csv"))
    poses = sorted((asked.data / "da_vinci_poses").glob("*.csv"))
    asked.out.write_text(introduced(parameters(straight)), encoding="utf-8")
    with_maps(asked.out, [*straight, *poses])


if __name__ == "__main__":
    main()

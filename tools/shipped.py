"""Fit the shipped rig `da-vinci-grasper` anew: `python -m tools.shipped DATA [--out RIG.toml]`.

Other shipped rigs are descriptions; this is the one that logs taught. The folder has
`da_vinci_grasper` (a straight wrist) and `da_vinci_poses` (four others) of the public repository
that docs/how-to/da-vinci.md names. The command `distal fit` finds the parameters on the straight
wrist, from the round numbers of examples/da_vinci/start.toml, as they are used after a homing move
of 3 s; then the maps learn from the logs of all poses.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
from tests.support.maps import with_learned_map

from distal import load_rig, read_log
from distal.fitting.fit import write_fitted

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


def fit_parameters(logs: list[Path], out: Path) -> None:
    """Write the rig file that `distal fit` makes of logs of a straight wrist."""
    words = [*map(str, logs), "--rig", str(START), "--homing", f"{HOMING:g}s"]
    options = ["--groups", CLASSES, "--out", str(out)]
    subprocess.run([sys.executable, "-m", "distal", "fit", *words, *options], check=True)


def introduced(text: str) -> str:
    """Return the rig file with what the fitted one is, in place of what the round numbers were."""
    return text.replace(BEFORE, AFTER).replace(", before fitting", "")


def with_maps(path: Path, logs: list[Path]) -> None:
    """Put the maps that logs of all poses teach into a rig file."""
    text = introduced(path.read_text(encoding="utf-8"))
    path.write_text(text, encoding="utf-8")
    learned = rig = load_rig(path).bare()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = [read_log(log, rig) for log in logs]
        for kind in ("readings", "filter"):
            learned = with_learned_map(read, learned, kind, HOMING)
    assert learned.map is not None
    for name, found in learned.map.named().items():
        errors = ", ".join(f"{np.rad2deg(rms):.3f}°" for rms in found.rms)
        print(f"map.{name}: on logs left out an RMS error of {errors}")
    account, _, _ = text.partition("\n\n")
    write_fitted(path, learned, rig, {}, f"{account}\n\n", text)
    load_rig(path)


def main() -> None:
    """Fit and write."""
    parser = argparse.ArgumentParser(prog="python -m tools.shipped", description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, default=SHIPPED)
    asked = parser.parse_args()
    straight = sorted((asked.data / "da_vinci_grasper").glob("run_*.csv"))
    poses = sorted((asked.data / "da_vinci_poses").glob("*.csv"))
    fit_parameters(straight, asked.out)
    with_maps(asked.out, [*straight, *poses])


if __name__ == "__main__":
    main()

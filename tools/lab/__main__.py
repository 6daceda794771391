"""The page on which a rig moves in the browser with its filter: `python -m tools.lab RIG --out
lab.html`; needs ziglang (`pip install '.[lab]'`).
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from distal.errors import DistalError
from distal.rig import load_rig
from tools.lab import check_ziglang, lab_page


def main(words: Sequence[str] | None = None) -> None:
    """Write the page of a rig."""
    parser = argparse.ArgumentParser(prog="python -m tools.lab", description=__doc__)
    parser.add_argument("rig", help="a rig file, or a shipped rig's name")
    parser.add_argument("--out", type=Path, required=True, help="the page (HTML), one file")
    parser.add_argument("--estimator", help="the filter; the rig's by default")
    parser.add_argument("--set", action="append", default=[], help="another value: KEY=VALUE")
    asked = parser.parse_args(words)
    try:
        check_ziglang()
        rig = load_rig(asked.rig, asked.set)
        settings = (f"--set {shlex.quote(setting)}" for setting in asked.set)
        source = " ".join([shlex.quote(asked.rig), *settings])
        lab_page(rig, asked.out, asked.estimator, source)
    except DistalError as problem:
        sys.exit(str(problem))
    size = asked.out.stat().st_size / 1000
    print(f"wrote {asked.out}: one file of {size:.0f} kB; open it in a browser")


if __name__ == "__main__":
    main()

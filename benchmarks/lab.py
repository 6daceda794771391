"""The lab in headless Chromium: size, time to the first frame, frames a second, and work in a
frame.

`python -m benchmarks.lab [RIG …]`; needs ziglang and a browser.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tests.browser import opened
from tools.lab import lab_page

from benchmarks.report import table
from distal import load_rig

RIGS = ("paper-2008", "wrist-instrument", "finger-n-plus-1", "hand")
WATCHED = 5.0
"""How long frames are counted [s]."""


def looked_at(path: Path, width: int) -> tuple[float, float, list[float]]:
    """Return when the first frame was drawn [ms], frames a second, and the work in each [ms]."""
    with opened(path, "", width, 900) as page:
        time.sleep(1.5)
        page.value("lab.times = []")
        before = page.value("[Number(lab.dataset.frames), performance.now()]")
        time.sleep(WATCHED)
        after = page.value("[Number(lab.dataset.frames), performance.now()]")
        rate = 1000.0 * (after[0] - before[0]) / (after[1] - before[1])
        return float(page.value("lab.dataset.first")), rate, page.value("lab.times")


def main() -> None:
    """Measure, print and save."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in sys.argv[1:] or RIGS:
            rig = load_rig(name)
            path = lab_page(rig, Path(folder) / "lab.html", source=name)
            for width in (1400, 400):
                first, rate, work = looked_at(path, width)
                rows.append(
                    [
                        name,
                        f"{len(rig.joints)}",
                        f"{path.stat().st_size / 1000:.0f}",
                        f"{width}",
                        f"{first:.0f}",
                        f"{rate:.0f}",
                        f"{np.median(work):.1f}",
                    ]
                )
    columns = [
        "rig",
        "joints",
        "file [kB]",
        "width [pixels]",
        "first frame [ms]",
        "frames a second",
        "work in a frame [ms]",
    ]
    table("lab", "The lab in headless Chromium", columns, rows)


if __name__ == "__main__":
    main()

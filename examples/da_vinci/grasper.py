# %% [markdown]
# # The jaw of a da Vinci grasper, without its encoder
#
# Run it as a script (`python examples/da_vinci/grasper.py`), or cell by cell in an editor that knows `# %%`.
# It needs twelve public logs, which are fetched once.

# %%
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import distal
from distal.fitting import AS_GIVEN, WRITTEN
from logs import da_vinci_grasper

parser = argparse.ArgumentParser()
parser.add_argument("--runs", nargs="*", default=None, help="e.g. 00 21 42; default all twelve")
parser.add_argument("--out", type=Path, default=Path("out/da-vinci"))
arguments = parser.parse_args()
arguments.out.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## What one has before any fit
# A rig file with round numbers, and how far off each may be. `hold = true` keeps a std for fitting only.

# %%
start = distal.load_rig(Path(__file__).with_name("start.toml"))
paths = [
    p
    for p in da_vinci_grasper()
    if arguments.runs is None or p.stem.removeprefix("run_") in arguments.runs
]
logs = [distal.read_log(path, start) for path in paths]
print(f"{len(logs)} logs, {sum(log.time[-1] for log in logs):.0f} s")

# %% [markdown]
# ## Homing
# The encoder is zeroed wherever a run starts. So the jaw's angle is known for the first three seconds, and then only
# compared with. Without tendons that stretch, and without what they keep back, the angle is off by more than a degree:

# %%
log = logs[0]
for name in ("inextensible", "adaptive"):
    result = distal.estimate(log, start, name, homing=3.0)
    print(
        f"{name:>14}: {np.rad2deg(result.rms_error()):.2f}°, {100 * result.inside_band():.0f} % inside the band"
    )

# %% [markdown]
# ## Fit to all logs, as it will be used
# The likelihood of what is predicted after homing. Nine numbers.

# %%
classes = r"run_(.)" if len({path.stem[4] for path in paths}) > 1 else None
found = distal.fit(logs, start, homing=3.0, groups=classes)
for part in found.fitted:
    print(f"{part.name:32} {part.start:10.5g} -> {part.value:10.5g} ± {part.error:.2g} {part.si}")
text = Path(__file__).with_name("start.toml").read_text(encoding="utf-8")
found.save(arguments.out / "fitted.toml", text)

# %% [markdown]
# ## Is it right on other motions?
# Runs are named XY, X being the class of motion. Each class was left out of the fit once, as a whole: halves of one
# periodic run would know each other.

# %%
for one in found.compared:
    print(
        f"{Path(one.log).stem}: {np.rad2deg(one.scores[AS_GIVEN].rms):.2f}° -> {np.rad2deg(one.scores[WRITTEN].rms):.2f}°"
    )
for name, rms, inside in found.scores():
    print(f"{name}: mean {np.rad2deg(rms):.2f}°, {100 * inside:.0f} % inside the band")

# %% [markdown]
# ## Look at it

# %%
distal.estimate(log, found.rig, homing=3.0).plot(arguments.out / "jaw.png")
print("wrote", arguments.out / "jaw.png")

"""The moving picture of the README: `python -m tools.moving` writes docs/figures/catalogue.gif and
prints its numbers.

It also prints the same of 20 other rigs of one joint, with which nothing was chosen: the picture is
of one of the better.

A joint between two motors whose rig file holds numbers as catalogues have them, each with what is
not known of it. Nothing is fitted. The plant is another: its numbers are drawn from those stds, and
its code shares nothing with `distal.model`.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from PIL import Image
from tests.support.drawn_logs import FITTED, logs_of
from tests.support.drawn_rigs import drawn_rig

from distal import Estimate, estimate
from distal.confidence import BAND
from distal.results import COLOURS, DASHES, figure
from distal.rig import build_rig

OUT = Path("docs/figures/catalogue.gif")
SEED = 1
"""The first of the drawn rigs that has one joint."""
NAMES = {"adaptive": 0, "inextensible": 3}
FRAMES, PER_SECOND, DPI, COLOURS_USED = 72, 9, 100, 48


def dial(axes: Axes, shown: dict[str, Estimate], at: int) -> None:
    """Draw the link at its true angle and where each estimate says that it is."""
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set(xlim=(-0.15, 1.3), ylim=(-0.78, 0.78))
    for degrees in range(-40, 41, 10):
        direction = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
        axes.plot(*np.outer(direction, [1.1, 1.14]), color="0.6", lw=0.8)
        if degrees % 20 == 0:
            axes.text(
                *(1.22 * direction),
                f"{degrees}°",
                ha="center",
                va="center",
                fontsize=7,
                color="0.4",
            )
    truths = shown["adaptive"].truths
    assert truths is not None
    true = truths[at, 0]
    axes.plot(
        [0, np.cos(true)], [0, np.sin(true)], color="0.8", lw=13, solid_capstyle="round", zorder=1
    )
    axes.plot([0, 1.09 * np.cos(true)], [0, 1.09 * np.sin(true)], color="black", lw=1.4, zorder=3)
    axes.plot(0, 0, "o", color="white", mec="black", ms=13, zorder=5)
    for name, index in NAMES.items():
        angle = shown[name].theta[at]
        reach = np.array([0.2, 1.09])
        axes.plot(
            np.cos(angle) * reach,
            np.sin(angle) * reach,
            color=COLOURS[index],
            ls=DASHES[index],
            lw=1.8,
            zorder=4,
        )


def errors(axes: Axes, shown: dict[str, Estimate], at: int) -> None:
    """Draw the errors up to now, and the band of adaptive."""
    time = shown["adaptive"].time
    band = np.rad2deg(BAND * shown["adaptive"].theta_std)
    axes.fill_between(
        time[: at + 1], -band[: at + 1], band[: at + 1], color=COLOURS[0], alpha=0.2, lw=0
    )
    axes.axhline(0.0, color="black", lw=0.8)
    ends = {name: float(np.rad2deg(shown[name].errors())[at]) for name in NAMES}
    upper = max(ends, key=lambda name: ends[name])
    apart = (
        max(0.0, 0.6 - (max(ends.values()) - min(ends.values()))) / 2.0
    )  # so that names do not lie on each other
    for name, index in NAMES.items():
        error, aside = np.rad2deg(shown[name].errors()), apart if name == upper else -apart
        axes.plot(time[: at + 1], error[: at + 1], color=COLOURS[index], ls=DASHES[index], lw=1.3)
        axes.text(
            time[at] + 0.1,
            ends[name] + aside,
            name,
            color=COLOURS[index],
            fontsize=8,
            va="center",
            clip_on=False,
        )
    axes.set(
        xlim=(0, time[-1] * 1.16), ylim=(-5, 5), xlabel="time [s]", ylabel="error of the angle [°]"
    )


def estimates_of(seed: int) -> dict[str, Estimate]:
    """Return the estimates of the first log that no fit would see, with the numbers as in the
    catalogue.
    """
    described = drawn_rig(seed, False)
    log, rig = logs_of(described, seed)[0][FITTED], build_rig(described.raw, "catalogue")
    return {name: estimate(log, rig, name) for name in NAMES}


def others() -> None:
    """Print what other rigs of one joint give."""
    seeds = [seed for seed in range(600, 642) if len(drawn_rig(seed, False).raw["joints"]) == 1]
    every = [estimates_of(seed) for seed in seeds]
    for name in NAMES:
        errors = [float(np.rad2deg(each[name].rms_error())) for each in every]
        inside = [each[name].inside_band() for each in every]
        print(
            f"{name}, {len(seeds)} other rigs: median RMS {np.median(errors):.2f}°, inside "
            f"{np.mean(inside):.0%}"
        )


def main() -> None:
    """Write the picture and print its numbers."""
    shown = estimates_of(SEED)
    for name, result in shown.items():
        half = float(np.rad2deg(BAND * result.theta_std.mean()))
        print(
            f"{name}: RMS {np.rad2deg(result.rms_error()):.2f}°, band ±{half:.1f}°, inside "
            f"{result.inside_band():.0%}"
        )
    pictures = []
    for at in np.linspace(0, len(shown["adaptive"]) - 1, FRAMES).astype(int):
        with figure(1, 2, (7.2, 2.7), width_ratios=[1, 1.7]) as (made, (left, right)):
            dial(left, shown, at)
            errors(right, shown, at)
            buffer = io.BytesIO()
            made.savefig(buffer, format="png", dpi=DPI)
        pictures.append(
            Image.open(buffer).convert("RGB").quantize(COLOURS_USED, dither=Image.Dither.NONE)
        )
    # it begins with its end, which stands still: what shows one frame only shows all
    pictures = [pictures[-1], *pictures[:-1]]
    durations = [3000] + [round(1000 / PER_SECOND)] * (FRAMES - 1)
    pictures[0].save(
        OUT, save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=True
    )
    others()


if __name__ == "__main__":
    main()

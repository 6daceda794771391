"""The first picture of the page: a moving link, its angle by inextensible tendons, and its estimate
with a band.
"""

from __future__ import annotations

from importlib import resources

import numpy as np

from distal.confidence import BAND
from distal.paper.series import SeriesRun
from distal.reports.page import heading, paragraph, script_with
from distal.results import BLACK, COLOURS, FAINT, SOFT

STEP = 0.02
"""Time between two frames [s]. Source: layout."""

FIRST = 0.8
"""Time of a run at which the picture begins [s]; the heavier weight is hung at 1 s. Source:
layout.
"""

LAST = 7.0
"""Time of a run at which the picture ends [s]. Source: layout."""


def moving_link(run: SeriesRun) -> list[str]:
    """Return the picture of the moving link and a text that explains its band, as parts of a
    page.
    """
    estimate = run.estimates["adaptive"]
    naive = run.estimates["inextensible"]
    time = run.log.time
    frames = np.arange(time[0] + FIRST, min(time[-1], time[0] + LAST), STEP)

    def course(values: np.ndarray) -> list[float]:
        return [round(float(value), 4) for value in np.interp(frames, time, values)]

    positions = [sensor.name for sensor in run.rig.sensors_of("position")]
    data = {
        "step": STEP,
        "truth": course(run.log.truth["theta"]),
        "naive": course(naive.theta),
        "estimate": course(estimate.theta),
        "half": course(BAND * estimate.theta_std),
        "positions": [
            [round(x - found[0], 5) for x in found]
            for found in (course(run.log.channels[n]) for n in positions)
        ],
    }
    errors = {
        name: np.rad2deg(run.estimates[name].rms_error()) for name in ("inextensible", "adaptive")
    }
    half = float(np.rad2deg(np.median(BAND * estimate.theta_std)))
    script = resources.files("distal.paper").joinpath("moving.js").read_text(encoding="utf-8")
    cord = f"<path class='cord' fill='none' stroke='{SOFT}' stroke-width='2'/>"
    link = (
        "<line class='{}' stroke='{}' stroke-width='{}' stroke-linecap='round' "
        "stroke-dasharray='{}'/>"
    )
    picture = (
        "<figure id='link'><svg viewBox='-230 -165 420 330' role='img' aria-label='A link on two "
        "tendons as it moves' "
        f"style='max-height:22rem'>{cord}{cord}<circle r='34' fill='none' stroke='{FAINT}' "
        "stroke-width='3'/>"
        f"<path class='fan' fill='{COLOURS[0]}' fill-opacity='0.3'/>"
        f"{link.format('truth', BLACK, 7, 'none')}"
        f"{link.format('naive', COLOURS[3], 4, '9 9')}</svg>"
        "<p><button type='button'>Pause</button> <output></output></p>"
        f"<input type='range' min='0' max='{frames[-1] - frames[0]:.2f}' step='any' value='0' "
        "aria-label='time' "
        "style='width:100%'><figcaption>Black: where the link is. Dashed: what its sliders say as "
        "if the tendons did not "
        "stretch. Blue fan: where distal says it is. No estimate has a sensor at the "
        "joint.</figcaption></figure>"
    )
    return [
        picture,
        script_with("link-data", data, script),
        heading("What the fan is"),
        paragraph(
            "A 95 % band: of a hundred moments the link should be inside it in ninety-five. Here "
            "it is inside in "
            f"{100 * estimate.inside_band():.0f} %, and half of the band is {half:.1f}°. The less "
            "is known, the wider it "
            f"is. Read as if nothing stretched, this link is {errors['inextensible']:.1f}° off "
            "(RMS), as distal says it "
            f"{errors['adaptive']:.1f}°."
        ),
    ]

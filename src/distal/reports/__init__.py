"""Reports: figures and HTML pages on rigs and studies.

In: a rig, a study's folder, or the paper's series; out: SVG and pages without scripts.

    from distal.reports import rig_svg
    from distal.rig import load_rig

    print(rig_svg(load_rig("finger-2n"))[:60])
"""

from distal.reports.rig_drawing import draw_rig, rig_svg
from distal.reports.study_report import study_report

__all__ = [
    "draw_rig",
    "rig_svg",
    "study_report",
]

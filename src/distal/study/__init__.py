"""Design studies: many designs of a rig, rigs as built of each design, and the share of these that
meets a requirement.

In: a study file with designs, tolerances and a requirement; out: a folder of rows, and an answer
with its standard error, √(p (1 − p)/n). An interrupted study goes on where it stopped.

    from distal.study import load_study

    print(type(load_study("paper")).__name__)
"""

from distal.study.design_space import (
    Plan,
    Space,
    Study,
    load_study,
    plan_of,
    shipped_studies,
    space_of,
)
from distal.study.runs import open_folder, run_study

__all__ = [
    "Plan",
    "Space",
    "Study",
    "load_study",
    "open_folder",
    "plan_of",
    "run_study",
    "shipped_studies",
    "space_of",
]

"""Export a filter as C for microcontrollers, or as an FMU.

In: a rig and an estimator; out: C99 without malloc, which steps (kernel_state, x) →
(kernel_state⁺, y) with the rig's numbers written in, or a block for Simulink with it.

    import distal

    made = distal.export_c(distal.load_rig("capstan-joint"), "firmware", single=True)
    print(made.name, made.state_bytes)
"""

from distal.export.c_source import (
    Exported,
    c_filter,
    c_name,
    check_ours,
    export_c,
    export_files,
)
from distal.export.fmu import Fmu, export_fmu

__all__ = [
    "Exported",
    "Fmu",
    "c_filter",
    "c_name",
    "check_ours",
    "export_c",
    "export_files",
    "export_fmu",
]

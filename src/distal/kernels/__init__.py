"""Kernels: the model's functions made fast. They are compiled as C once, or run in CasADi's
interpreter.

In: a CasADi function (kernel_state, x, p) → (kernel_state⁺, y); out: the same over all samples of a
run, of one or of several side by side in vector lanes. Rigs of one structure share a kernel.

    import casadi as ca
    import numpy as np
    from distal.kernels import Feed, Kernel, advance

    state, x, p = (ca.SX.sym(name) for name in "sxp")
    mean = Kernel(ca.Function("mean", [state, x, p], [state + p * (x - state), state]), False)
    run = advance(mean, Feed(np.zeros(1), np.ones((5, 1)), np.array([0.5])))
    print(run.kernel_states[-1])
"""

from distal.kernels.compiler import (
    Recipe,
    Structure,
    c_source,
    cache_folder,
    find_compiler,
    structure_of,
)
from distal.kernels.kernel import (
    AT_ONCE,
    Compiled,
    Evaluation,
    Indices,
    Kernel,
    LaneKernel,
    PlacedKernel,
    advance,
    advance_all,
    at_samples,
    function_of,
    in_order,
    kernel_of,
    lanes_here,
    side_by_side,
)
from distal.kernels.layout import (
    Advanced,
    Feed,
    Layout,
    covariance_of,
    kernel_state_layout,
    mean_of,
    variances_of,
)

__all__ = [
    "AT_ONCE",
    "Advanced",
    "Compiled",
    "Evaluation",
    "Feed",
    "Indices",
    "Kernel",
    "LaneKernel",
    "Layout",
    "PlacedKernel",
    "Recipe",
    "Structure",
    "advance",
    "advance_all",
    "at_samples",
    "c_source",
    "cache_folder",
    "covariance_of",
    "find_compiler",
    "function_of",
    "in_order",
    "kernel_of",
    "kernel_state_layout",
    "lanes_here",
    "mean_of",
    "side_by_side",
    "structure_of",
    "variances_of",
]

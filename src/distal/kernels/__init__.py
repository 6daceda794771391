"""Kernels: the model's functions made fast. They are compiled as C once, or run in CasADi's
interpreter.
"""

from distal.kernels.cache import Recipe, Structure, cache_folder, structure_of
from distal.kernels.compiler import c_source, find_compiler
from distal.kernels.driver import (
    Indices,
    PlacedKernel,
    advance,
    advance_all,
    at_samples,
    in_order,
    side_by_side,
)
from distal.kernels.kernel import (
    AT_ONCE,
    Compiled,
    Evaluation,
    Kernel,
    forget,
    function_of,
    kernel_of,
)
from distal.kernels.lanes import LaneKernel, lanes_here
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
    "forget",
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

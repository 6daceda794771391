"""A small kernel that shows whether kernels are compiled, and whether compiled and interpreted
numbers agree.
"""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from distal.kernels.kernel import Backend, Kernel


def probe() -> tuple[Backend, str, float]:
    """Return the backend in use, the reason for it (or the compiler), and the largest difference
    between it and the interpreter in a small scan.
    """
    kernel_state = ca.MX.sym("kernel_state", 2)
    x = ca.MX.sym("x", 1)
    p = ca.MX.sym("p", 2)
    following = ca.vertcat(
        kernel_state[0] + 0.01 * kernel_state[1],
        kernel_state[1] * ca.exp(-p[1] * 0.01) - 0.01 * p[0] * ca.sin(kernel_state[0]) + x,
    )
    function = ca.Function(
        "probe",
        [kernel_state, x, p],
        [following, ca.sum1(following**2)],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        kernel = Kernel(function)
    inputs = np.linspace(-1.0, 1.0, 200).reshape(-1, 1)
    start = np.array([0.3, 0.0])
    parameters = np.array([9.0, 0.5])
    run = kernel.scan(start, inputs, parameters)
    interpreted = Kernel(function, compiled=False).scan(start, inputs, parameters)
    return (
        kernel.backend,
        kernel.reason,
        float(max(np.abs(a - b).max() for a, b in zip(run, interpreted))),
    )

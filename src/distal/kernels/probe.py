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
    angle, speed = ca.vertsplit(kernel_state)
    x = ca.MX.sym("x")
    p = ca.MX.sym("p")
    following = ca.vertcat(angle + 0.01 * speed, speed - 0.01 * p * ca.sin(angle) + x)
    function = ca.Function("probe", [kernel_state, x, p], [following, ca.exp(-angle)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        kernel = Kernel(function)
    inputs = np.linspace(-1.0, 1.0, 200)
    run, interpreted = (
        np.hstack(backend.scan(np.array([0.3, 0.0]), inputs, np.array([9.0])))
        for backend in (kernel, Kernel(function, compiled=False))
    )
    return kernel.backend, kernel.reason, float(np.abs(run - interpreted).max())

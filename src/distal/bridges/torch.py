"""Many estimators of one rig, step by step together, on the processor or on a GPU: for policies
that are trained on what an estimator says and not on the truth.

An array goes to PyTorch or JAX without a copy (`torch.from_dlpack(angles)`). On the processor the
estimators run in its vector lanes, on all cores. On a GPU each has a thread: the exported C with
qualifiers of CUDA, compiled by NVRTC through CuPy. Arrays are (groups, size, lanes): on a GPU there
is one group, and each of its estimators is a lane.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.codegen import Plain
from distal.errors import EstimationError
from distal.estimators import LARGEST_ANGLE, SHORTEST, make_estimator
from distal.estimators.estimator_protocol import MOST_BRIDGES, fill, predictions
from distal.kernels import Kernel, kernel_state_layout
from distal.kernels.compiler import emitted
from distal.logs import LARGEST_READING
from distal.rig import Rig, as_rig

THREADS = 64
"""Threads in a block of the GPU [1]. Source: definition (two warps; a thread's registers leave room
for few more).
"""

CUDA = """
#define restrict __restrict__
#ifndef NAN
#define NAN __builtin_nan("")
#define INFINITY __builtin_huge_val()
#endif
"""
"""What C99 has and CUDA has not."""

_EACH = """
/* one sample of n estimators whose arrays lie side by side */
extern "C" __global__ void {name}_step(long long n, double* kernel_state, const double* x,
                                       const double* p, double* y) {{
  const long long l = (long long)blockIdx.x * blockDim.x + threadIdx.x;
  double now[{n_kernel_state}], next[{n_kernel_state}], sample[{n_x}], out[{n_y}];
  int i;
  if (l >= n) return;
  for (i = 0; i < {n_kernel_state}; ++i) now[i] = kernel_state[i * n + l];
  for (i = 0; i < {n_x}; ++i) sample[i] = x[i * n + l];
  {name}(now, sample, p, next, out);
  for (i = 0; i < {n_kernel_state}; ++i) kernel_state[i * n + l] = next[i];
  for (i = 0; i < {n_y}; ++i) y[i * n + l] = out[i];
}}
"""

Step = Callable[[Floats, Floats, Floats], None]
"""Changes kernel states and outputs by a sample: (kernel_state, x, y)."""

Prepared = tuple[ModuleType, tuple[Floats, ...], Step]
"""NumPy or CuPy, its arrays of kernel states, samples and outputs, and what advances them."""


class Angles(NamedTuple):
    """Angles of joints after a sample: arrays of NumPy, or on a GPU of CuPy.

    Args:
        angles: of the joints [rad], (n, n_joints).
        stds: standard deviations of their errors [rad], (n, n_joints).
        restarted: which estimators left all bounds and begin anew with their next sample, (n,).
    """

    angles: Floats
    stds: Floats
    restarted: Bools


class BatchEstimator:
    """The same estimator n times, for n rigs that are described by one file.

    ```python
    estimator = BatchEstimator("finger-2n", 4096)
    angles, stds, restarted = estimator.step(0.01, samples)  # (4096, n_channels), SI
    estimator.reset(done)  # those where an episode ended begin with their next sample
    ```

    Args:
        rig: the description, or a shipped rig's name, or a path.
        n: number of estimators.
        estimator: its name; by default that of the rig.
        device: "cpu" or "cuda".

    Raises:
        EstimationError: n is no whole number from 1, the device is unknown or not there, or the
            estimator cannot run on this rig.
        RigError: the rig is unknown or wrong.
    """

    def __init__(
        self, rig: Rig | str | Path, n: int, estimator: str | None = None, device: str = "cpu"
    ) -> None:
        if isinstance(n, bool) or not isinstance(n, int) or n < 1:
            raise EstimationError(f"n: a whole number of estimators from 1, {n!r} came")
        if device not in ("cpu", "cuda"):
            raise EstimationError(f"device: 'cpu' or 'cuda', {device!r} came")
        self.rig = as_rig(rig)
        self._one = one = make_estimator(estimator, self.rig)
        self._n = n
        p = one.parameters
        self._xp, self._arrays, self._run = (
            _on_processor(one.kernel, p, n)
            if device == "cpu"
            else _on_gpu(one.kernel.function, p, n)
        )
        self._here: Callable[[Floats | Bools], Floats] = getattr(self._xp, "asnumpy", np.asarray)
        self._begins = np.ones(n, dtype=bool)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors in a sample, in its order."""
        return self._one.channels

    @property
    def joints(self) -> list[str]:
        """Names of the joints, in their order."""
        return self.rig.joint_names

    def reset(self, which: Sequence[int] | Bools | None = None) -> None:
        """Let estimators forget everything: their next sample is the first.

        Args:
            which: a mask of NumPy, (n,), or their indices; by default all.

        Raises:
            EstimationError: there is no such estimator.
        """
        try:
            self._begins[slice(None) if which is None else np.asarray(which)] = True
        except IndexError as problem:
            raise EstimationError(f"which: of {self._n} estimators; {problem}") from None

    def step(self, dt: float, samples: Floats) -> Angles:
        """Take in a sample of each estimator and return the joints' angles.

        Args:
            dt: time since the last sample [s].
            samples: values of `channels`, SI, NaN where missing, (n, n_channels), on the device.

        Raises:
            EstimationError: the interval is not above zero or too long, the shape is wrong, or a
                value is wild.
        """
        one = self._one
        xp = self._xp
        try:
            values = xp.asarray(samples, dtype=np.float64)
        except (TypeError, ValueError) as problem:
            raise EstimationError(f"samples: an array of numbers; {problem}") from None
        if values.shape != (self._n, len(one.channels)):
            raise EstimationError(
                f"samples must have shape ({self._n}, {len(one.channels)}) for {one.channels}, "
                f"{values.shape} came"
            )
        parts = predictions(dt, one.interval) if dt >= SHORTEST else 0
        if not 0 < parts <= MOST_BRIDGES:
            raise EstimationError(f"dt: an interval above 0 s that is no long gap, {dt:g} s came")
        if bool((abs(values) > LARGEST_READING).any()):
            raise EstimationError(f"a sample is wild: beyond {LARGEST_READING:g} in SI")
        begins = self._begins
        if begins.any():
            self._begin(begins, self._here(values))
        kernel_state, x, y = self._arrays
        width = len(one.channels)
        # views, (n_x, groups, lanes)
        steps, given, mask = xp.split(xp.moveaxis(x, 1, 0), (1, 1 + width))
        padded = xp.full((steps.size, width), np.nan)
        padded[: self._n] = values
        sample = padded.T.reshape(given.shape)
        is_finite = xp.isfinite(sample)
        sample = xp.where(is_finite, sample, 0.0)
        first = xp.asarray(np.pad(begins, (0, steps.size - self._n)))
        steps[:] = xp.where(first, 0.0, dt / parts).reshape(steps.shape)
        for rows_after in range(parts - 1, -1, -1):
            fill(given, mask, sample, is_finite, rows_after, one.bridged)
            self._run(kernel_state, x, y)
        return self._reported()

    def _reported(self) -> Angles:
        """Return the angles as they are reported, with the learned maps."""
        xp = self._xp
        kernel_state, _, y = self._arrays
        n = len(self._one.state_names)
        joints = len(self.joints)
        first = kernel_state_layout(n)["covariance"].start

        def rows(array: Floats, at: Sequence[int]) -> Floats:
            chosen: Floats = xp.moveaxis(array[:, list(at)], 1, 2).reshape(-1, len(at))[: self._n]
            return chosen

        means = rows(kernel_state, range(n))
        spreads = rows(kernel_state, range(first, first + n * n, n + 1))
        angles = means[:, :joints].copy()
        variances = spreads[:, :joints].copy()
        report = self._one.report
        if report.states:
            at = list(report.states)
            gains = rows(y, report.gains)
            angles[:, at] = rows(y, report.values)
            variances[:, at] = variances[:, at] * gains * gains + rows(y, report.variances)
        is_finite = (xp.isfinite(means) & xp.isfinite(spreads)).all(axis=1)
        lost = ~is_finite | (abs(angles) > LARGEST_ANGLE).any(axis=1)
        self._begins = self._here(lost) > 0
        return Angles(angles, xp.sqrt(xp.maximum(variances, 0.0)), lost)

    def _begin(self, which: Bools, values: Floats) -> None:
        """Set the kernel states of those that begin to their prior at these values."""
        kernel_state = self._arrays[0]
        lanes = kernel_state.shape[2]
        for k in np.flatnonzero(which):
            begin = self._one.initial(0.0, values[k]).kernel_state
            kernel_state[k // lanes, :, k % lanes] = self._xp.asarray(begin)


def _on_processor(kernel: Kernel, p: Floats, n: int) -> Prepared:
    """Return what holds kernel states, samples and outputs in vector lanes, and advances them."""
    lanes = kernel.lanes()
    sizes = kernel.sizes
    per_sample = sizes.kernel_state, sizes.x, sizes.y
    if lanes is None:
        arrays = tuple(np.zeros((n, size, 1)) for size in per_sample)

        def one_by_one(kernel_state: Floats, x: Floats, y: Floats) -> None:
            for state, sample, out in zip(kernel_state, x, y):  # (size, 1) each
                state.T[:], out.T[:] = kernel.scan(state, sample.T, p)

        return np, arrays, one_by_one
    groups = -(-n // lanes.lanes)
    arrays = tuple(lanes.empty(groups, size) for size in per_sample)
    common = lanes.empty(sizes.p)
    common[:] = p[:, None]
    workers = min(os.cpu_count() or 1, groups)
    ends = np.linspace(0, groups, workers + 1).astype(int)
    shares = [slice(*pair) for pair in pairwise(ends)]
    pool = ThreadPoolExecutor(workers)

    def side_by_side(kernel_state: Floats, x: Floats, y: Floats) -> None:
        list(pool.map(lambda at: lanes.step(kernel_state[at], x[at], common, y[at]), shares))

    return np, arrays, side_by_side


def cuda_source(function: ca.Function) -> str:
    """Return a kernel as CUDA: its C with qualifiers, and a function that advances many of them.

    Raises:
        CompileError: the function has an operation that has no C here.
    """
    text = emitted(function, Plain(), _EACH).replace("#include <math.h>", CUDA, 1)
    return re.sub(r"^static (inline |)(?=void|double)", r"static __device__ \1", text, flags=re.M)


def _on_gpu(function: ca.Function, p: Floats, n: int) -> Prepared:
    """Return what `_on_processor` does, on a GPU."""
    try:
        import cupy
    except ImportError:
        raise EstimationError("device 'cuda' needs CuPy; pip install '.[cuda]'") from None
    if not cupy.cuda.is_available():
        raise EstimationError("device 'cuda': CuPy finds no GPU; take device 'cpu'")
    module = cupy.RawModule(code=cuda_source(function), options=("--std=c++14", "--fmad=false"))
    advance = module.get_function(f"{function.name()}_step")
    sizes = function.numel_in(0), function.numel_in(1), function.numel_out(1)
    arrays = tuple(cupy.zeros((1, size, n)) for size in sizes)
    common = cupy.asarray(p)

    def all_at_once(kernel_state: Floats, x: Floats, y: Floats) -> None:
        blocks = -(-n // THREADS)
        advance((blocks,), (THREADS,), (np.int64(n), kernel_state, x, common, y))

    return cupy, arrays, all_at_once

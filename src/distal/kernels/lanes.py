"""Many runs of one kernel side by side, one in each vector lane."""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Sequence
from functools import lru_cache
from math import prod

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.codegen import Lanes
from distal.kernels.cache import Recipe, cpu
from distal.kernels.compiler import (
    OPTIMISED_LANES,
    emitted,
    library_of,
    loaded,
)
from distal.kernels.layout import Advanced, Feed

_BATCH = """
/* {lanes} runs of {name}: of each sample's kernel_state the numbers `keep` are kept, and y; a run
 * that ended rests */
void {name}_batch(const long long* rows, const double* const* kernel_state, const double* const* x,
                  const double* const* p,
                  long long n_keep, const int* keep, double* const* kept, double* const* y) {{
  V c[2][{n_kernel_state}], sample[{n_x}], numbers[{n_p}], out[{n_y}];
  long long k, most = 0, i;
  int l;
  for (l = 0; l < {lanes}; ++l) {{
    for (i = 0; i < {n_kernel_state}; ++i) c[0][i][l] = kernel_state[l][i];
    for (i = 0; i < {n_p}; ++i) numbers[i][l] = p[l][i];
    if (rows[l] > most) most = rows[l];
  }}
  for (k = 0; k < most; ++k) {{
    const V* now = c[k & 1];
    V* next = c[~k & 1];
    for (l = 0; l < {lanes}; ++l) {{
      const double* row = x[l] + k * {n_x};
      for (i = 0; i < {n_x}; ++i) sample[i][l] = k < rows[l] ? row[i] : 0.0;
    }}
    {name}(now, sample, numbers, next, out);
    for (l = 0; l < {lanes}; ++l) {{
      if (k >= rows[l]) continue;
      for (i = 0; i < n_keep; ++i) kept[l][k * n_keep + i] = next[keep[i]][l];
      for (i = 0; i < {n_y}; ++i) y[l][k * {n_y} + i] = out[i][l];
    }}
  }}
}}

/* one sample of groups of {lanes} runs each, whose kernel states are changed in place */
void {name}_step(long long groups, V* kernel_state, const V* x, const V* p, V* y) {{
  V next[{n_kernel_state}];
  long long g, i;
  for (g = 0; g < groups; ++g, kernel_state += {n_kernel_state}, x += {n_x}, y += {n_y}) {{
    {name}(kernel_state, x, p, next, y);
    for (i = 0; i < {n_kernel_state}; ++i) kernel_state[i] = next[i];
  }}
}}
"""


@lru_cache(maxsize=1)
def lanes_here() -> int:
    """Return the number of vector lanes: how many numbers of double precision this processor takes
    at once.
    """
    features = cpu()
    if "avx512f" in features:
        return 8
    return 4 if "avx2" in features or platform.machine() == "x86_64" else 2


def _source(function: ca.Function) -> str:
    lanes = lanes_here()
    return emitted(function, Lanes(lanes), _BATCH, lanes=lanes)


class LaneKernel:
    """A kernel (kernel_state, x, p) → (kernel_state⁺, y) over several runs at once. Its results are
    those of one run after the other.

    Raises:
        CompileError: there is no compiler, or it does not know vectors, or the function has no C.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.lanes = lanes_here()
        library = library_of(recipe, f"{self.lanes} lanes", _source, OPTIMISED_LANES)
        self.sizes = library.sizes
        self._batch = loaded(
            library, "batch", [*4 * [ctypes.c_void_p], ctypes.c_longlong, *3 * [ctypes.c_void_p]]
        )
        self._step = loaded(library, "step", [ctypes.c_longlong, *4 * [ctypes.c_void_p]])

    def scan(self, feeds: Sequence[Feed], keep: Sequence[int]) -> list[Advanced]:
        """Return the results of several runs: of the kernel state after each row only the numbers
        `keep`, (k, len(keep)), and the outputs.

        Args:
            feeds: at most `lanes` runs, which may differ in length.
            keep: indices of numbers of the kernel state.
        """
        dense = [feed.dense(self.sizes) for feed in feeds]
        lengths = np.zeros(self.lanes, dtype=np.int64)
        lengths[: len(feeds)] = [len(feed.rows) for feed in dense]
        out = [
            Advanced(np.empty((rows, len(keep))), np.empty((rows, self.sizes.y)))
            for rows in lengths[: len(feeds)]
        ]
        kept = np.array(keep, dtype=np.int32)
        # lanes without a run of their own begin as the first one, with no rows, and keep nothing
        self._batch(
            lengths.ctypes.data,
            *(self._pointers(arrays) for arrays in zip(*dense)),
            len(kept),
            kept.ctypes.data,
            *(self._pointers(arrays) for arrays in zip(*out)),
        )
        return out

    def empty(self, *shape: int) -> Floats:
        """Return an array of zeros (…, lanes) that begins where vectors may begin in memory."""
        size = prod(shape) * self.lanes
        room = np.zeros(size + self.lanes)
        first = -room.ctypes.data // room.itemsize % self.lanes
        return room[first : first + size].reshape(*shape, self.lanes)

    def step(self, kernel_state: Floats, x: Floats, p: Floats, y: Floats) -> None:
        """Advance groups of runs by one sample each; `kernel_state` and `y` are changed in place.

        Args:
            kernel_state: (groups, n_kernel_state, lanes), as of `empty`.
            x: (groups, n_x, lanes).
            p: the parameters that all have in common, (n_p, lanes).
            y: (groups, n_y, lanes).
        """
        self._step(len(x), *(array.ctypes.data for array in (kernel_state, x, p, y)))

    def _pointers(self, arrays: Sequence[Floats]) -> ctypes.Array[ctypes.c_void_p]:
        filled = [*arrays, *[arrays[0]] * (self.lanes - len(arrays))]
        return (ctypes.c_void_p * self.lanes)(*(array.ctypes.data for array in filled))

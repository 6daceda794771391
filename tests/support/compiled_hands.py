"""The sub-steps of `servo_hands` as C, which a compiler makes 30 times as fast; without one NumPy does
them.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@cache
def advance() -> Callable[..., None] | None:
    """Return the function of one hand, None without a compiler."""
    if shutil.which(os.environ.get("CC", "cc")) is None:
        return None
    source = Path(__file__).with_name("servo_hands.c").read_text(encoding="utf-8")
    return compiled(source, "advance")


@lru_cache(maxsize=8)
def compiled(source: str, name: str) -> Callable[..., None]:
    """Return a function of C source, compiled once and kept."""
    key = hashlib.sha256(source.encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"plants-{os.getuid()}"
    library = folder / f"{key}.so"
    if not library.exists():
        folder.mkdir(mode=0o700, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as built:
            code, made = Path(built) / "plant.c", Path(built) / "plant.so"
            code.write_text(source, encoding="utf-8")
            flags = ["-O2", "-ffp-contract=off", "-fPIC", "-shared"]
            compiler = os.environ.get("CC", "cc")
            subprocess.run([compiler, *flags, str(code), "-o", str(made), "-lm"], check=True)
            made.replace(library)
    function: Callable[..., None] = getattr(ctypes.CDLL(str(library)), name)
    return function


def called(
    function: Callable[..., None], sizes: tuple[int, ...], step: float, *arrays: Any
) -> None:
    """Call it for one hand: tendons, joints, motors and sub-steps, the step [s], its arrays."""
    held = [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in held)
    function(*map(ctypes.c_long, sizes), ctypes.c_double(step), *pointers)


def contiguous(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy that C may change."""
    return np.array(array, dtype=np.float64, order="C")

"""Kernels that a process keeps by their structure: rigs that differ in their numbers alone share
one.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable
from threading import RLock
from typing import TypeVar, cast

import casadi as ca

from distal.kernels.kernel import Compiled, Kernel
from distal.kernels.structure import Recipe, Structure

MOST_KEPT = 128
"""Largest number of kernels and functions that a process keeps; those that were not asked for the
longest go first. Source: judgement.
"""

_KEPT: OrderedDict[tuple[object, ...], object] = OrderedDict()
_TURNS = RLock()

Made = TypeVar("Made")


def kernel_of(
    structure: Structure | None,
    make: Callable[[], ca.Function],
    compiled: Compiled = True,
) -> Kernel:
    """Return the kernel of a structure: the one that this process keeps, or a new one.

    Args:
        structure: all that the kernel depends on; None for a new kernel that is not kept.
        make: returns its function, which must depend on the structure alone.
        compiled: as for `Kernel`.
    """
    if structure is None:
        return Kernel(Recipe(make), compiled)
    wishes = tuple(os.environ.get(name) for name in ("DISTAL_COMPILE", "DISTAL_CACHE", "CC"))
    key = (structure.key, compiled, *wishes)
    recipe = _kept((structure.key, "recipe"), lambda: Recipe(make, structure))
    return _kept(key, lambda: Kernel(recipe, compiled))


def function_of(structure: Structure, make: Callable[[], ca.Function]) -> ca.Function:
    """Return the function of a structure, for a function that is not called often enough for a
    kernel: the one that this process keeps, or a new one.
    """
    return _kept((structure.key,), make)


def forget() -> None:
    """Drop all kernels and functions that this process keeps, so that they are made anew."""
    with _TURNS:
        _KEPT.clear()


def _kept(key: tuple[object, ...], make: Callable[[], Made]) -> Made:
    with _TURNS:
        made = _KEPT.get(key)
        if made is None:
            made = _KEPT[key] = make()
            if len(_KEPT) > MOST_KEPT:
                _KEPT.popitem(last=False)
        _KEPT.move_to_end(key)
    return cast(Made, made)

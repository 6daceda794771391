"""Kernels that a process keeps by their structure: what differs in numbers alone shares one."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable
from threading import RLock
from typing import Literal, TypeVar, cast

import casadi as ca

from distal.kernels.kernel import Kernel
from distal.kernels.recipe import Recipe
from distal.kernels.structure import Structure

MOST_KEPT = 128
"""Kernels and functions that a process keeps; those not asked for the longest go first."""

_KEPT: OrderedDict[tuple[object, ...], object] = OrderedDict()
_TURNS = RLock()

Made = TypeVar("Made")


def kernel_of(
    structure: Structure | None,
    make: Callable[[], ca.Function],
    compiled: bool | Literal["lanes"] = True,
) -> Kernel:
    """Return the kernel of a structure: the one that this process has, or a new one.

    Args:
        structure: None for a kernel of its own.
        make: returns its function, which must depend on the structure alone.
        compiled: as of `Kernel`.
    """
    if structure is None:
        return Kernel(Recipe(make), compiled)
    wishes = tuple(os.environ.get(name) for name in ("DISTAL_COMPILE", "DISTAL_CACHE", "CC"))
    key = (structure.key, compiled, *wishes)
    recipe = _kept((structure.key, "recipe"), lambda: Recipe(make, structure))
    return _kept(key, lambda: Kernel(recipe, compiled))


def function_of(structure: Structure, make: Callable[[], ca.Function]) -> ca.Function:
    """Return a function that is called now and then, of a structure: the one that this process has,
    or a new one.
    """
    return _kept((structure.key,), make)


def forget() -> None:
    """Drop what this process keeps, so that kernels are made anew."""
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

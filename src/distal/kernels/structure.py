"""The structure on which a kernel depends: rigs that agree in it share the kernel, whatever their
numbers are.

How to make the function of a kernel. It is made only where it is needed, since a compiled kernel
is found by its structure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from threading import RLock

import casadi as ca
from pydantic import BaseModel

from distal.kernels.cache import digest
from distal.kernels.layout import Sizes
from distal.model import Mechanism
from distal.rig import Parameter, Rig
from distal.rig.joints import Coupling

INPUTS = frozenset(
    {
        "centre",
        "correlation_time",
        "counts_per_turn",
        "curve",
        "delay",
        "error",
        "error_time",
        "gear",
        "gravity",
        "inertia",
        "lag",
        "lever",
        "limit",
        "linearity",
        "noise",
        "offset",
        "orientation",
        "rate",
        "reference",
        "resolution",
        "std",
        "stops",
        "torque_constant",
        "torque_constant_motor",
        "unmodelled",
    }
)
"""Fields of plain numbers that are inputs of kernels, or do not enter them; any other field is
written into a kernel.
"""

APART = frozenset(
    {
        "name",
        "log",
        "provisional",
        "when_lost",
        "stepping",
        "map",
        "free_motion",
        "touch",
    }
)
"""Fields of a rig that say nothing of its equations, or whose part in a structure is given
separately.
"""


@dataclass(frozen=True)
class Structure:
    """All that a kernel depends on.

    Args:
        kind: of the kernel, such as ``plant``.
        facts: (name, content) of each thing that the kernel is made for.
    """

    kind: str
    facts: tuple[tuple[str, object], ...]

    @cached_property
    def key(self) -> str:
        """Name of the structure in a cache; it changes with the code of the package."""
        return digest(self.kind, repr(self.facts), source_stamp())


def structure_of(kind: str, mechanism: Mechanism, **decisions: object) -> Structure:
    """Return the structure of a kernel that is made from a rig's equations.

    Args:
        kind: of the kernel, such as ``plant``.
        decisions: anything else that it is made for, such as its sub-steps.
    """
    parameters = mechanism.parameters
    facts = {
        "parts": _parts(mechanism.rig),
        "numbers": parameters.names,
        "absent": parameters.constants,
        **{name.replace("_", " "): value for name, value in decisions.items()},
    }
    return Structure(kind, tuple(facts.items()))


def _parts(rig: Rig) -> tuple[object, ...]:
    return tuple(
        (name, _shape(getattr(rig, name))) for name in type(rig).model_fields if name not in APART
    )


def _shape(part: object) -> object:
    """Return a component of a description without its numbers."""
    if isinstance(part, Parameter):
        return None
    if isinstance(part, Coupling):
        return part.model_dump_json()
    if isinstance(part, BaseModel):
        return tuple(
            (name, _of_field(name, getattr(part, name))) for name in type(part).model_fields
        )
    if isinstance(part, tuple):
        return tuple(map(_shape, part))
    return part


def _of_field(name: str, field: object) -> object:
    if name in INPUTS and not isinstance(field, BaseModel):
        return field is None
    return _shape(field)


@lru_cache(maxsize=1)
def source_stamp() -> str:
    """Return a digest of the package's code: kernels of other code are other kernels."""
    files = sorted(Path(__file__).parents[1].rglob("*.py"))
    return digest(*(path.read_bytes() for path in files))


_MAKING = RLock()  # CasADi does not count its symbols safely over threads


class Recipe:
    """A CasADi function (kernel_state, x, p) → (kernel_state⁺, y) that is made at its first use.

    Args:
        make: returns the function.
        structure: all that the function depends on; where it is None, compiled kernels are found by
            their C instead.
    """

    def __init__(self, make: Callable[[], ca.Function], structure: Structure | None = None) -> None:
        self._make = make
        self.structure = structure

    @cached_property
    def function(self) -> ca.Function:
        """The CasADi function, made at the first call."""
        with _MAKING:
            return self._make()

    def written(self, source: Callable[[ca.Function], str]) -> str:
        """Return the C that `source` writes of the function."""
        function = self.function
        with _MAKING:
            return source(function)

    @property
    def sizes(self) -> Sizes:
        """The lengths of the kernel state, x, p and y."""
        function = self.function
        inputs = (function.numel_in(i) for i in range(3))
        return Sizes._make([*inputs, function.numel_out(1)])

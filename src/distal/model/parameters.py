"""The symbols of functions: the parameters of a rig as one vector, so that a changed value never
rebuilds the model, and the other arguments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np
from pydantic import BaseModel

from distal.arrays import Floats
from distal.errors import RigError
from distal.expressions import Scalar, Vector
from distal.rig import Parameter, Rig, part_at

_NO_PARAMETERS = frozenset({"initial", "nominal_force", "settled", "axis", "range"})
"""Keys that are not part of the equations of motion (the start, and what stands in for a missing
force sensor), or are written into the model's expressions as they are.
"""

NEUTRAL = (".exponent", ".let_out", ".scale")
"""Ends of the names of parameters that change nothing where they are exactly one."""


Symbolic = TypeVar("Symbolic", ca.SX, ca.MX)


@dataclass(frozen=True)
class Derived:
    """Values, by name, that are computed from a description. They become symbols behind its
    parameters, or constants of the expressions where they are `folded` into them.
    """

    values: Mapping[str, float]
    folded: bool = False


NOTHING_DERIVED = Derived({})


class Parameters:
    """The parameters in the equations of motion: names (paths as in ``--set``), values, stds,
    drifts and symbols, (n_p,) each.

    A drift that is not given is NaN. A std covers all that is not known of a value. The part of it
    that no other parameter shares is in `independent_stds`. The parts that several parameters share
    are in `shared`: name → (std as a share of the values, indices of these parameters).

    A parameter that is zero with ``std = 0``, and one of `NEUTRAL` that is exactly one, are
    constants of the expressions, so that they cost no operations.

    Args:
        inputs: paths that stay symbols whatever their values, because they will be changed:
            parameters, and other numbers of the description (a sensor's noise), which are put
            behind the parameters. They have std 0.
        inside: names of the internal state, which come last; see `Tendons`.
        derived: values that are computed from the description, behind the inputs.

    Raises:
        RigError: a path is not a number of the rig.
    """

    def __init__(
        self,
        rig: Rig,
        inputs: Sequence[str] = (),
        inside: Sequence[str] = (),
        derived: Derived = NOTHING_DERIVED,
    ) -> None:
        self.inputs = tuple(inputs)
        self.inside = tuple(inside)
        self.folded = derived.folded
        self._constants: dict[str, float] = {}
        self.shared: dict[str, tuple[float, list[int]]] = {}

        def certain(value: float) -> tuple[float, float, float, float]:
            return value, 0.0, np.nan, 0.0

        rows: dict[str, tuple[float, float, float, float]] = {}
        for name, parameter in _walk(rig):
            known = (parameter.value, parameter.filter_std)
            if name in self.inputs:
                rows[name] = certain(parameter.value)
            elif parameter.absent or (name.endswith(NEUTRAL) and known == (1.0, 0.0)):
                self._constants[name] = parameter.value
            else:
                shared = parameter.shared
                if shared is not None and shared.std > 0.0 and not parameter.hold:
                    self.shared.setdefault(shared.name, (shared.std, []))[1].append(len(rows))
                drift = np.nan if parameter.drift is None else parameter.drift
                rows[name] = (*known, drift, 0.0 if parameter.hold else parameter.std)
        rows |= {name: certain(number_at(rig, name)) for name in self.inputs if name not in rows}
        if derived.folded:
            self._constants |= derived.values
        else:
            rows |= {name: certain(value) for name, value in derived.values.items()}
        rows |= dict.fromkeys(inside, certain(0.0))
        self.names = tuple(rows)
        self.all_names = tuple(name for name, _ in _walk(rig))
        columns: list[Floats] = [np.array(column) for column in zip(*rows.values())]
        self.values, self.stds, self.drifts, self.independent_stds = columns
        self.symbols: Vector = ca.SX.sym("p", len(rows))
        self._index = {name: i for i, name in enumerate(rows)}

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, name: str) -> Scalar:
        """Return the symbol (or the constant) of a parameter that the rig has."""
        if name in self._constants:
            return ca.SX(self._constants[name])
        return self.symbols[self._index[name]]

    def __contains__(self, name: str) -> bool:
        return name in self._index or name in self._constants

    def index(self, name: str) -> int:
        """Return the index of a parameter among the symbols."""
        return self._index[name]

    def of(self, p: Symbolic, names: Sequence[str]) -> Symbolic:
        """Return some parameters of the vector `p` of all, (n_p,). The `names` are either all
        symbols or all constants of the expressions, whose values are then returned.
        """
        if all(name in self._index for name in names):
            return p[[self._index[name] for name in names]]
        return type(p)(ca.DM([self._constants[name] for name in names]))

    @property
    def constants(self) -> tuple[tuple[str, float], ...]:
        """Names and values of the parameters that are constants, because the rig does not have what
        they describe.
        """
        return tuple(self._constants.items())

    def has(self, name: str) -> bool:
        """Return whether a parameter exists and is not a constant zero."""
        return name in self._index or self._constants.get(name, 0.0) != 0.0


def number_at(rig: Rig, path: str) -> float:
    """Return the number at a path of the description.

    A parameter counts as its value, a drift that is not given as 0.

    Raises:
        RigError: there is no number at the path.
    """
    part = part_at(rig, path)
    if isinstance(part, Parameter):
        return part.value
    if part is None and path.endswith(".drift"):
        return 0.0
    if isinstance(part, (int, float)):
        return float(part)
    raise RigError(f"{rig.name}: '{path}' is not a number of the rig")


def _walk(rig: Rig) -> Iterator[tuple[str, Parameter]]:
    if rig.is_chain:
        yield from _walk_part(rig.base, "base")
    for kind in ("joints", "drives", "tendons"):
        for i, part in enumerate(rig.components[kind]):
            yield from _walk_part(part, f"{kind}.{i}")
    for i, joint in enumerate(rig.joints):
        if joint.friction is not None:
            yield f"joints.{i}.friction.reference", Parameter(value=rig.reference_load(i))


def _walk_part(part: BaseModel | tuple[object, ...], path: str) -> Iterator[tuple[str, Parameter]]:
    stops = getattr(part, "stops", None)
    for key, field in enumerate(part) if isinstance(part, tuple) else part:
        name = f"{path}.{key}"
        if key in _NO_PARAMETERS or (stops is None and str(key).startswith("stop_")):
            continue
        if key == "stops" and stops is not None:
            # tiny offsets keep a stop at exactly zero from being read as an absent parameter
            yield f"{name}.low", Parameter(value=stops[0] or -1e-300)
            yield f"{name}.high", Parameter(value=stops[1] or 1e-300)
        elif isinstance(field, Parameter):
            yield name, field
        elif isinstance(field, (BaseModel, tuple)):
            yield from _walk_part(field, name)
        elif isinstance(field, float) and isinstance(part, tuple):
            yield name, Parameter(value=field)

"""Numbers of a description by their path, with their unit, bound and std."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel

from distal.errors import RigError
from distal.rig.naming import index_of, names_in
from distal.rig.quantities import In, Parameter
from distal.rig.rig import Rig
from distal.suggestions import did_you_mean

ROUGH = 0.5
"""Share of its value above which the std of a positive number means that the number is known to a
factor only [1]. Source: judgement.
"""

ROUGH_ARM = 0.2
"""The same share for a moment arm [1]. Source: judgement."""


def known_to_a_factor(path: str, value: float, std: float) -> bool:
    """Return whether the positive number at a path is known to a factor only: its `std` is above
    `ROUGH` of its `value`, of a moment arm above `ROUGH_ARM`.
    """
    return std > (ROUGH_ARM if is_arm(path) else ROUGH) * value > 0.0


def is_arm(path: str) -> bool:
    """Return whether the number at a path is a moment arm; readings show only its product with an
    angle.
    """
    return (
        ".insertion." in path
        or ".crossings." in path
        or (path.startswith("drives.") and path.endswith(".radius"))
    )


@dataclass(frozen=True)
class Number:
    """A number of a description.

    Args:
        path: keys and indices joined by dots, names of parts replaced by their indices.
        value: in SI.
        std: of all that is not known of the value; 0 where it has none.
        quantity: its unit and bound.
        is_parameter: whether it may have a std.
        hold: whether its std is for fitting only.
        shared: name of the error that it shares with others, and the std of that as a share of the
            value; None if it shares none.
        independent_std: of its own error alone.
    """

    path: str
    value: float
    std: float
    quantity: In
    is_parameter: bool
    hold: bool = False
    shared: tuple[str, float] | None = None
    independent_std: float = 0.0

    @property
    def is_rough(self) -> bool:
        """Whether the number is known to a factor only and must be positive: its prior is then
        log-normal.
        """
        return self.quantity.bound == "positive" and known_to_a_factor(
            self.path, self.value, self.std
        )


def number(rig: Rig, path: str) -> Number:
    """Return a number of a rig by its path, which names parts by index or by name, as in ``--set``.

    Raises:
        RigError: the path leads nowhere, or to what is no number with a unit.
    """
    part: object = rig
    owner: type[BaseModel] | None = None
    field = ""
    keys: list[str] = []
    for key in path.split("."):
        if isinstance(part, tuple):
            index = index_of(part, key)
            if index is None:
                raise RigError(f"'{path}': there is no '{key}'{did_you_mean(key, names_in(part))}")
            part = part[index]
            key = str(index)
        elif isinstance(part, BaseModel) and not isinstance(part, Parameter):
            if key not in type(part).model_fields:
                raise RigError(
                    f"'{path}': there is no '{key}'{did_you_mean(key, type(part).model_fields)}"
                )
            owner = type(part)
            field = key
            part = getattr(part, key)
        else:
            raise RigError(f"'{path}': '{'.'.join(keys)}' is a plain value and has no '{key}'")
        keys.append(key)
    quantity = None
    if owner is not None:
        quantity = next((m for m in owner.model_fields[field].metadata if isinstance(m, In)), None)
    if quantity is None or not isinstance(part, (Parameter, int, float)):
        raise RigError(
            f"'{path}' is not a number with a unit; give the path of one, e.g. "
            f"joints.{rig.joints[0].name}.inertia"
        )
    if isinstance(part, Parameter):
        shared = (
            (part.shared.name, part.shared.std)
            if part.shared is not None and part.shared.std > 0.0
            else None
        )
        return Number(
            ".".join(keys), part.value, part.total_std, quantity, True, part.hold, shared, part.std
        )
    return Number(".".join(keys), float(part), 0.0, quantity, False)

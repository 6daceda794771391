"""Numbers of a description by their path, with what is allowed for them."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel

from distal.errors import RigError
from distal.rig.naming import index_of, names_in
from distal.rig.quantities import In, Parameter
from distal.rig.rig import Rig
from distal.suggestions import did_you_mean

ROUGH = 0.5
ROUGH_ARM = 0.2
"""A positive number, or a moment arm, whose std is above this share of it is known to a factor
only.
"""


def known_to_a_factor(path: str, value: float, std: float) -> bool:
    """Return whether of a positive number, of some value and std, only the order of magnitude is
    known.
    """
    return std > (ROUGH_ARM if is_arm(path) else ROUGH) * value > 0.0


def is_arm(path: str) -> bool:
    """Return whether a number is a moment arm: it shows in the readings as its product with the
    angle only.
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
        std: what is not known of its value; 0 where it has none.
        hold: whether its std is for fitting only.
        shared: the name of what it errs by together with others, and how much as a share of the
            value; None if alone.
        independent_std: what is not known of it alone.
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
        """Whether it is known to a factor only and cannot be zero: its prior is then log-normal."""
        return self.quantity.bound == "positive" and known_to_a_factor(
            self.path, self.value, self.std
        )


def number(rig: Rig, path: str) -> Number:
    """Return a number of a description by its path, as in ``--set``: parts by index or by name;
    others are errors.
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

"""One unknown value of the adaptive filter: its prior, how it changes, and what it adds to the
model or to a reading. `StateVector` joins these values and sums up what they add.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from distal.estimators.state_kinds import StateKind
from distal.expressions import Scalar

Acts = Literal["value", "factor", "deviation"]
"""How a state enters the model's parameters: it is the value of one, it multiplies the values of
all, or it is added to the value of one.
"""

Target: TypeAlias = tuple[str, int | str]
"""What a state adds to: ``("torque", joint)`` [N m]; of a drive its ``"position"`` where nothing
measures it, its ``"friction"`` limit, and the ``"lacking force"`` by which its pull is less than
expected, by index; ``("reading", sensor)``, by name.
"""


@dataclass(frozen=True)
class Begin:
    """The readings of a log's first sample.

    Args:
        positions: of the drives [m, rad], 0 where nothing is read.
        efforts: of the drives [N, N m], None without a sensor.
        tensions: of the tendons [N], None without a sensor.
    """

    positions: Sequence[Scalar]
    efforts: Sequence[Scalar | None]
    tensions: Sequence[Scalar | None]


def unchanged(reading: Scalar) -> Scalar:
    """Return 1: what a state adds does not depend on a reading."""
    return 1


@dataclass(frozen=True, eq=False)
class State:
    """One unknown value, in SI. What the filter does with it follows from its `kind`.

    Args:
        name: of the state; that of a parameter is in words.
        kind: of the state.
        part: the component that it belongs to: the name of a joint, drive, tendon or sensor, or the
            path of a parameter, with ".factor" or ".deviation" after it where the state is that.
        mean: prior mean.
        std: prior standard deviation.
        to: what it adds to, if anything.
        times: function of the reading, by whose result the state is multiplied before it is added.
        indices: of the model's parameters that it enters.
        acts: how it enters them.
        walk: standard deviation that it gains as a random walk, per √s.
        lowest: lower limit at which it is kept.
        unidentified: whether forces and displacements do not tell it; then only a reference angle
            teaches it.
        doubted: whether it is friction of a joint that is known to a factor only.
        mean_by: the prior mean as an expression of inputs of the filter, which a fit may vary.
        std_by: the same for the standard deviation.
        fades_in: time constant with which it fades towards zero, as such an expression [s]: x⁺ = f
            x + noise of variance σ² (1 − f²), f = e^{−dt/T}, with the prior's std σ.
        first: mean and standard deviation at the first sample, where its readings give them.
        inputs: name → value of the inputs of the filter's kernel that follow from it, see
            `FilterContext.number`.
    """

    name: str
    kind: StateKind
    part: str
    mean: float
    std: float
    to: Target | None = None
    times: Callable[[Scalar], Scalar] = unchanged
    indices: tuple[int, ...] = ()
    acts: Acts = "value"
    walk: float = 0.0
    lowest: float = -np.inf
    unidentified: bool = False
    doubted: bool = False
    mean_by: Callable[[], Scalar] | None = None
    std_by: Callable[[], Scalar] | None = None
    fades_in: Callable[[], Scalar] | None = None
    first: Callable[[Begin], tuple[Scalar, Scalar]] | None = None
    inputs: Mapping[str, float] = field(default_factory=dict)

    @property
    def structure(self) -> tuple[object, ...]:
        """What the structure of a kernel depends on in this state: all but its values."""
        bounded = bool(np.isfinite(self.lowest))
        acts = self.indices, self.acts, self.unidentified, self.doubted
        return self.name, self.kind.name, self.walk > 0.0, bounded, *acts

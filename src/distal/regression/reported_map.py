"""The function of a filter that reports some of its states with learned maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import casadi as ca

from distal.expressions import VectorNode
from distal.kernels.layout import is_read
from distal.regression.features import Shape
from distal.regression.homed_map import homed_function, homed_layout
from distal.regression.map_function import map_function, map_layout
from distal.rig import LearnedMap

CARRIED_TIME = 0.3
"""Time constant with which a map's correction is forgotten while something touches a joint [s]: the
map was learned in free motion, and does not hold there. Source: benchmark (docs/results/touch.md).
"""


@dataclass(frozen=True)
class ReportedMap:
    """A map beside a filter.

    Args:
        learned: the map.
        channels: indices of the filter's channels that it reads.
        states: indices of the filter's states that it speaks of.
        homes: for each of its joints the index of the channel that says where it is known to stand;
            none where no channel does.
        is_touched: whether something may touch a joint.
    """

    learned: LearnedMap
    channels: tuple[int, ...]
    states: tuple[int, ...]
    homes: tuple[int, ...] = ()
    is_touched: bool = False

    @property
    def shape(self) -> Shape:
        """The sizes of its features."""
        return Shape.of(self.learned)

    @property
    def joints(self) -> int:
        """Number of its joints."""
        return len(self.learned.joints)

    @property
    def memory(self) -> int:
        """Length of its memory, in which are its weights where angles may be known."""
        layout = homed_layout(self.shape, self.joints) if self.homes else self.shape.memory
        return layout.size

    @property
    def carried(self) -> int:
        """Number of values that are remembered while something touches a joint: one for each joint,
        none for a map of the torque.
        """
        return self.joints if self.is_touched and self.learned.beside_filter else 0

    @property
    def size(self) -> int:
        """Length of all that is remembered."""
        return self.memory + self.carried

    @property
    def parameters(self) -> int:
        """Number of its parameters."""
        return map_layout(self.shape, self.joints).size


def reporting_function(
    inner: ca.Function,
    maps: Sequence[ReportedMap],
    positions: Sequence[int | None],
    variances: Sequence[int],
    touched: Sequence[int] = (),
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of a filter that also reports
    some of its states with learned maps.

    The filter's own states are as without maps. In y, after the filter's own outputs, stand for
    each map the reported values of its states, the gains of these states' own errors, and the
    variances that are added; see `distal.estimators.belief`. Channels that say where a joint is
    known to stand condition the map; the filter does not read them.

    A map beside the filter was learned in free motion. Where touches have shares of the joints, of
    which w is the largest, the map's difference d from the filter's own angle θ is kept and
    forgotten: d⁺ = (1 − w) (value − θ) + w e^{−dt/T} d. The filter's own error then counts more:
    gain⁺ = (1 − w) gain + w.

    Args:
        inner: the filter's function; the first states are the joints' own.
        maps: what is reported.
        positions: for each channel the index in the kernel state of its drive's position, None for
            a channel that is read.
        variances: indices in the kernel state of the variances of the joints' angles.
        touched: for each joint that may be touched, the index in the kernel state of the share that
            a touch has of it.
    """
    n_kernel_state = inner.size1_in(0)
    n_parameters = inner.size1_in(2)
    kernel_state = ca.MX.sym("kernel_state", n_kernel_state + sum(placed.size for placed in maps))
    x = ca.MX.sym("x", inner.size1_in(1))
    p = ca.MX.sym("p", n_parameters + sum(placed.parameters for placed in maps))
    width = (x.numel() - 1) // 2
    read = ca.MX(x)
    for home in {home for placed in maps for home in placed.homes}:
        read[1 + width + home] = 0
    following, y = inner(kernel_state[:n_kernel_state], read, p[:n_parameters])
    memories = []
    reports = []
    at = n_kernel_state
    number = n_parameters
    share = reduce(ca.fmax, (following[at] for at in touched), ca.MX(0))
    left = share * ca.exp(-x[0] / CARRIED_TIME)
    for placed in maps:
        inputs: list[VectorNode] = [
            x[1 + i]
            if positions[i] is None or not placed.learned.beside_filter
            else following[positions[i]]
            for i in placed.channels
        ]
        angles = following[list(placed.states)]
        if placed.shape.angles:
            inputs.append(angles)
        mask = x[[1 + width + i for i in placed.channels]]
        memory = kernel_state[at : at + placed.memory]
        parameters = p[number : number + placed.parameters]
        arguments = [memory, x[0], ca.vertcat(*inputs), mask, parameters]
        if placed.homes:
            homes = list(placed.homes)
            given = x[[1 + i for i in homes]] - angles
            is_given = is_read(x[[1 + width + i for i in homes]])
            beside = following[[variances[i] for i in placed.states]]
            function = homed_function(placed.shape, placed.joints)
            values, gains, spreads, after = function(*arguments, given, is_given, beside)
        else:
            values, gains, spreads, after = map_function(placed.shape, placed.joints)(*arguments)
        if not placed.learned.beside_filter:
            values = values - angles
            gains = ca.MX.zeros(len(placed.states))
        if placed.carried:
            # while touched, nobody knows whether the correction still holds
            spreads = spreads + share * values**2
            carried = kernel_state[at + placed.memory : at + placed.size]
            values = (1 - share) * values + left * carried
            gains = (1 - share) * gains + share
            after = ca.vertcat(after, values)
        reports += [angles + values, gains, spreads]
        memories.append(after)
        at += placed.size
        number += placed.parameters
    return ca.Function(
        "reporting",
        [kernel_state, x, p],
        [ca.vertcat(following, *memories), ca.vertcat(y, *reports)],
    )

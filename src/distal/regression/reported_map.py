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


@dataclass(frozen=True)
class ReportedMap:
    """A map beside a filter.

    Args:
        learned: the map.
        channels: indices of the filter's channels that it reads.
        states: indices of the filter's states that it speaks of; maps of the same ones are pooled.
        homes: for each of its joints the index of the channel that says where it is known to stand;
            none where no channel does.
    """

    learned: LearnedMap
    channels: tuple[int, ...]
    states: tuple[int, ...]
    homes: tuple[int, ...] = ()

    @property
    def shape(self) -> Shape:
        """The sizes of its features."""
        return Shape.of(self.learned)

    @property
    def joints(self) -> int:
        """Number of its joints."""
        return len(self.learned.joints)

    @property
    def size(self) -> int:
        """Length of its memory, in which are its weights where angles may be known."""
        layout = homed_layout(self.shape, self.joints) if self.homes else self.shape.memory
        return layout.size

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
    which s is the largest, the filter's own error and what the map adds, a, count as unknown:
    gain⁺ = (1 − s) gain + s, variance⁺ = variance + s a². Its share of a pool goes towards one
    half, since the shares are of free motion too.

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
    answers = dict[tuple[int, ...], list[tuple[VectorNode, ...]]]()
    at = n_kernel_state
    number = n_parameters
    opened = reduce(ca.fmax, (following[at] for at in touched), ca.MX(0))
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
        memory = kernel_state[at : at + placed.size]
        parameters = p[number : number + placed.parameters]
        arguments = [memory, x[0], ca.vertcat(*inputs), mask, parameters]
        if placed.homes:
            homes = list(placed.homes)
            given = x[[1 + i for i in homes]]
            is_given = is_read(x[[1 + width + i for i in homes]])
            beside = ca.MX.zeros(len(homes))
            if placed.learned.beside_filter:
                given = given - angles
                beside = following[[variances[i] for i in placed.states]]
            function = homed_function(placed.shape, placed.joints)
            values, gains, spreads, after = function(*arguments, given, is_given, beside)
        else:
            values, gains, spreads, after = map_function(placed.shape, placed.joints)(*arguments)
        if placed.learned.beside_filter:
            # while touched, nobody knows whether the map still holds
            spreads = spreads + opened * values**2
            gains = (1 - opened) * gains + opened
            values = angles + values
        else:
            gains = ca.MX.zeros(len(placed.states))
        share = map_layout(placed.shape, placed.joints).part(parameters, "share")
        share = (1 - opened) * share + opened / 2
        answers.setdefault(placed.states, []).append((values, gains, spreads, share))
        memories.append(after)
        at += placed.size
        number += placed.parameters
    reports = [part for of_states in answers.values() for part in _pooled(*of_states)]
    return ca.Function(
        "reporting",
        [kernel_state, x, p],
        [ca.vertcat(following, *memories), ca.vertcat(y, *reports)],
    )


def _pooled(
    beside: Sequence[VectorNode], alone: Sequence[VectorNode] | None = None
) -> tuple[VectorNode, ...]:
    """Return the value, gain and variance of some states by a map beside the filter and one on
    readings alone: the mean and the variance of the linear pool of both, of which the second has
    the share 1 − w.

    With the difference d of their values, the value is w a + (1 − w) b and the variance w v_a +
    (1 − w) v_b + w (1 − w) d² (Stone, The opinion pool, Annals of Mathematical Statistics 32,
    1961).

    Args:
        beside: value, gain, variance and share.
        alone: the same of the map on readings alone; None where there is none.
    """
    value, gain, spread, _ = beside
    if alone is None:
        return value, gain, spread
    second, _, second_spread, other = alone
    share = 1 - other
    return (
        share * value + other * second,
        ca.sqrt(share) * gain,
        share * spread + other * second_spread + share * other * (value - second) ** 2,
    )

"""A cable in its sheath, with friction along its way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from distal.expressions import Scalar
from distal.model.plays import SOFTEST, Bounds
from distal.model.springs import stretched

STIFFENING_STEPS = 6
"""Number of Halley steps to the position at which two stretches of a cable that stiffens balance;
one Newton step follows. The worst of 4000 random cables is then 7 µm off, with 8 Newton steps alone
4 mm. Source: judgement.
"""


@dataclass(frozen=True)
class Sheath:
    """A cable in its sheath, as springs in series with points of friction between them.

    With N points each of the two stretches at the ends is 1/(2N) of the cable's length and each one
    between two points is 1/N, so that all together have the cable's stiffness. At each point the
    tensions on its two sides differ by a factor of at most e^{μβ/N} (the capstan equation).

    The points, (N,), and the ends, `drive` and `joint`, are given by their displacements [m].

    Args:
        stiffness: of the whole cable, k [N/m].
        drawn: e^{μβ/N} while the cable is drawn in.
        let_out: e^{μβ/N} while the cable is let out.
        count: number of points, N.
        stiffening: a [1/m] of the whole cable, None for a linear spring; see `stretched`.
        pretension: tension about which it stiffens [N].
    """

    stiffness: Scalar
    drawn: Scalar
    let_out: Scalar
    count: int
    stiffening: Scalar | None = None
    pretension: Scalar = 0.0

    @property
    def shares(self) -> list[float]:
        """The shares of the cable's length that the stretches are, from the drive to the joint, (N
        + 1,).
        """
        return [1 / (2 * self.count), *([1 / self.count] * (self.count - 1)), 1 / (2 * self.count)]

    def tension(self, stretch: int, extension: Scalar) -> Scalar:
        """Return the tension of a stretch of the cable [N], negative where slack.

        The `stretch` is its index, counted from the drive; its `extension` [m] is counted from its
        length without tension.
        """
        share = self.shares[stretch]
        if self.stiffening is None:
            return self.stiffness / share * extension
        return _tension(extension, share, self.stiffness, self.stiffening, self.pretension)

    def bounds(self, point: int, before: Scalar, after: Scalar) -> Bounds:
        """Return the bounds of a point m [m] between its two neighbours.

        The neighbour `before` it, towards the drive, is displaced by l [m], and the neighbour
        `after` it, towards the joint, by r [m]. The point is drawn in where T₁(l − m) > e T₂(m −
        r), and let out where T₂(m − r) > e T₁(l − m).
        """
        drawn = self._held_at(point, before, after, 1, self.drawn)
        let_out = self._held_at(point, before, after, self.let_out, 1)
        # where the cable is slack, both "tensions" are negative and the bounds change sides
        return Bounds(ca.fmin(drawn, let_out), ca.fmax(drawn, let_out))

    def _held_at(
        self, point: int, before: Scalar, after: Scalar, near: Scalar, far: Scalar
    ) -> Scalar:
        """Return the position m at which a T₁(l − m) = b T₂(m − r), with a = `near` and b =
        `far`.
        """
        shares = self.shares[point : point + 2]
        if self.stiffening is None:
            return _linear_balance(before, after, near, far, *shares)
        cable = (self.stiffness, self.stiffening, self.pretension)
        inputs = (before, after, near, far, *shares, *cable)
        search, step = _equal_tensions()
        near_it, _ = search(*inputs)
        return step(near_it, *inputs)

    def settled(self, points: list[Scalar], drive: Scalar, joint: Scalar) -> list[Scalar]:
        """Return the positions at which the `points` come to rest between the ends `drive` and
        `joint`, (N,) [m], by sweeps to and fro.
        """
        line = [drive, *points, joint]
        for point in self.order():
            line[point + 1] = self.bounds(point, line[point], line[point + 2]).hold(line[point + 1])
        return line[1:-1]

    def order(self) -> list[int]:
        """Return the points in the order in which `settled` visits them: from the drive to the
        joint and back, N times.
        """
        forth = list(range(self.count))
        back = forth[-2::-1]
        return forth + back + (forth[1:] + back) * (self.count - 1)

    def middle(self, drive: Scalar, joint: Scalar) -> list[Scalar]:
        """Return the displacements of the points between the ends `drive` and `joint` for which the
        tension is equal all along the cable, (N,) [m].
        """
        return [drive + (joint - drive) * (2 * i + 1) / (2 * self.count) for i in range(self.count)]

    def tensions(self, points: list[Scalar], drive: Scalar, joint: Scalar) -> tuple[Scalar, Scalar]:
        """Return the tensions [N] at the ends `drive` and `joint` of a cable whose points are at
        `points`, zero where slack.
        """
        near = self.tension(0, drive - points[0])
        far = self.tension(self.count, points[-1] - joint)
        return ca.fmax(near, 0), ca.fmax(far, 0)


def _tension(
    extension: Scalar, share: float, stiffness: Scalar, stiffening: Scalar, pretension: Scalar
) -> Scalar:
    """Return the tension of a share of a cable that stiffens [N] at its `extension` [m]; the rest
    are of the whole cable.
    """
    stretch = stretched(extension / share - pretension / stiffness, stiffening)
    return pretension + stiffness * stretch


def _linear_balance(
    before: Scalar, after: Scalar, near: Scalar, far: Scalar, share: Scalar, next_share: Scalar
) -> Scalar:
    """Return the position at which a T₁(l − m) = b T₂(m − r) on a cable that does not stiffen."""
    first = near / share
    last = far / next_share
    return (first * before + last * after) / (first + last)


@lru_cache(maxsize=1)
def _equal_tensions() -> tuple[ca.Function, ca.Function]:
    """Return two functions: a search for the position m at which a T₁(l − m) = b T₂(m − r) on a
    cable that stiffens, by Halley's steps (Phil. Trans. 18, 1694), which have the second derivative
    too; and a last step of Newton from there.

    Both stay calls: copies of them for each point, sweep and derivative are millions of characters
    of C. The search has no derivative; the last step has the position's derivative by all inputs.
    """
    names = ("m", "l", "r", "a", "b", "share_1", "share_2", "stiffness", "stiffening", "pretension")
    position, *inputs = symbols = [ca.SX.sym(name) for name in names]
    before, after, near, far, share, next_share, *cable = inputs
    lacking = near * _tension(before - position, share, *cable)
    lacking -= far * _tension(position - after, next_share, *cable)
    slope = SOFTEST - ca.jacobian(lacking, position)
    bend = lacking * ca.hessian(lacking, position)[0] / (2 * slope)
    farthest = ca.fabs(before - after) + cable[2] / cable[0]
    newton, halley = (
        position + ca.fmax(ca.fmin(lacking / divisor, farthest), -farthest)
        for divisor in (slope, slope - ca.fmax(ca.fmin(bend, slope / 2), -slope / 2))
    )
    nearer = ca.Function("nearer", symbols, [ca.cse(halley)])
    found = begin = _linear_balance(*inputs[:6])
    for _ in range(STIFFENING_STEPS):
        found = nearer(found, *inputs)
    # with a second output the function differs from its derivative in their number
    options = {
        "never_inline": True,
        "is_diff_in": [False] * len(inputs),
        "is_diff_out": [True, False],
    }
    return (
        ca.Function("near_equal_tensions", inputs, [found, found - begin], options),
        ca.Function("equal_tensions", symbols, [ca.cse(newton)], {"never_inline": True}),
    )

"""Hands whose motors are position servos with a limit on current; nothing here is shared with
`distal.model`.

`orca_like` has a motor for each joint and two tendons on its spool, in sheaths, with slack or
tension between them; `aero_like` has fingers of three joints on one tendon, against springs. Every
number is drawn. Several hands step side by side: arrays are (hands, parts). A tendon is two springs
in series with dry friction of its sheath between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from distal.arrays import Floats
from tests.support.compiled_hands import advance, called, contiguous

STEP = 2.5e-4
"""Of the plant [s]."""

PERIOD = 0.01
"""Of commands and readings [s]."""

COUNTS = 4096
"""Of an encoder in one turn of the spool."""

TORQUE_CONSTANT = 0.5
"""What a catalogue says [N m/A]; of each motor it is another."""


MOVING = ("angles", "rates", "positions", "speeds", "nodes", "torques", "slipped")
"""What they change."""


@dataclass
class Drawn:
    """Numbers of some hands, (hands, parts); `arms` and `spools` are signed, (tendons, joints) and
    (tendons, motors).
    """

    arms: Floats
    spools: Floats
    low: Floats
    high: Floats
    slack: Floats
    stiffness: Floats
    sheath: Floats
    spring: Floats
    rest: Floats
    dry: Floats
    axle: Floats
    weight: Floats
    gear_friction: Floats
    gear_load: Floats
    torque_constant: Floats
    zeros: Floats
    signs: Floats


PARAMETERS = tuple(Drawn.__annotations__)[:14]
"""Of a `Drawn` what the sub-steps read: all before the torque constant."""


class Hands:
    """Some hands side by side, at rest, that follow goals of their motors' angles."""

    def __init__(self, drawn: Drawn, seed: int) -> None:
        self.d, self.rng = drawn, np.random.default_rng([seed, 7])
        hands, joints = drawn.low.shape
        motors = drawn.spools.shape[-1]
        self.angles = np.clip(np.zeros((hands, joints)), drawn.low, drawn.high)
        self.rates = np.zeros((hands, joints))
        self.positions, self.speeds = np.zeros((hands, motors)), np.zeros((hands, motors))
        self.nodes = np.zeros(drawn.slack.shape)
        self.torques, self.goals = np.zeros((hands, motors)), np.zeros((hands, motors))
        self.limits = np.full((hands, motors), 0.8)
        # of the motors' servos: stiffness [N m/rad], damping [N m s/rad], dead band [rad]
        self.stiffness, self.damping, self.dead_band = 6.0, 0.12, 0.0
        self.broken = np.zeros(drawn.slack.shape, dtype=bool)
        self.slips = np.full((hands, motors), np.inf)
        self.slipped = np.zeros((hands, motors))
        self.direction = np.zeros((hands, motors))
        self.compiled = True

    def _tensions(self) -> tuple[Floats, Floats]:
        """Return tensions at the spool and at the joint, with the sheath's node where friction lets
        it be.
        """
        d = self.d
        wound = np.einsum("htm,hm->ht", d.spools, self.positions - self.slipped) - d.slack
        drawn_in = np.einsum("htj,hj->ht", d.arms, self.angles)
        first, second, grip = 2 * d.stiffness, 2 * d.stiffness, np.exp(d.sheath)
        near, far = (
            np.maximum(first * (wound - self.nodes), 0),
            np.maximum(second * (self.nodes - drawn_in), 0),
        )
        out = (first * wound + grip * second * drawn_in) / (first + grip * second)
        back = (grip * first * wound + second * drawn_in) / (grip * first + second)
        node = np.where(near > grip * far, out, np.where(grip * near < far, back, self.nodes))
        # a tendon without tension follows the joint
        self.nodes = np.where(wound <= drawn_in, np.clip(self.nodes, wound, drawn_in), node)
        near, far = first * (wound - self.nodes), second * (self.nodes - drawn_in)
        return np.where(self.broken, 0, np.maximum(near, 0)), np.where(
            self.broken, 0, np.maximum(far, 0)
        )

    def _part(self) -> None:
        d = self.d
        near, far = self._tensions()
        load = np.einsum("htm,ht->hm", d.spools, near)
        # a servo: proportional to what is left, never above its limit
        left = self.goals - self.positions
        left = left - np.clip(left, -self.dead_band, self.dead_band)
        asked = self.stiffness * left - self.damping * self.speeds
        self.torques = np.clip(asked, -self.limits, self.limits)
        inertia = 2e-4
        free = self.speeds + STEP / inertia * (self.torques - load)
        grip = STEP / inertia * (d.gear_friction + d.gear_load * np.abs(load))
        self.speeds = np.sign(free) * np.maximum(np.abs(free) - grip, 0)
        self.positions = self.positions + STEP * self.speeds
        slip = np.abs(load) > self.slips
        self.slipped = self.slipped + np.where(slip, np.sign(load) * 0.4 * STEP * 20, 0)
        pull = np.einsum("htj,ht->hj", d.arms, far)
        side = np.einsum("htj,ht->hj", np.abs(d.arms), far)
        torque = (
            pull
            - d.spring * (self.angles - d.rest)
            - d.weight * np.sin(self.angles)
            - 1e-3 * self.rates
        )
        over = np.maximum(self.angles - d.high, 0) - np.maximum(d.low - self.angles, 0)
        torque -= np.where(over != 0, 25.0 * over + 0.02 * self.rates, 0)
        inertia = 1e-5
        free = self.rates + STEP / inertia * torque
        grip = STEP / inertia * (d.dry + d.axle * side)
        self.rates = np.sign(free) * np.maximum(np.abs(free) - grip, 0)
        self.angles = self.angles + STEP * self.rates

    def _period(self, steps: int) -> None:
        """Advance all hands by some sub-steps: in C where there is a compiler."""
        function = advance() if self.compiled else None
        if function is None:
            for _ in range(steps):
                self._part()
            return
        d, moving = self.d, [contiguous(getattr(self, name)) for name in MOVING]
        servo = np.array([self.stiffness, self.damping, self.dead_band])
        tendons, joints = d.arms.shape[1:]
        sizes = (tendons, joints, d.spools.shape[2], steps)
        parameters = [getattr(d, name) for name in PARAMETERS]
        given = [*parameters, self.broken, self.slips, self.limits, self.goals, *moving]
        for hand in range(len(d.arms)):
            called(function, sizes, STEP, servo, *(array[hand] for array in given))
        for name, array in zip(MOVING, moving):
            setattr(self, name, array)

    def step(self, goals: Floats) -> dict[str, Floats]:
        """Send goals [rad of the encoders], let a period pass, and return the places [rad] and
        currents [A] read then.
        """
        d = self.d
        self.goals = (np.asarray(goals) - d.zeros) * d.signs
        self._period(round(PERIOD / STEP))
        turn = 2 * np.pi / COUNTS
        positions = turn * np.round((self.positions * d.signs + d.zeros) / turn)
        currents = self.torques * d.signs / d.torque_constant + 0.004 * self.rng.normal(
            size=self.torques.shape
        )
        return {"positions": positions, "currents": 1e-3 * np.round(1e3 * currents)}

    def goals_of(self, positions: Floats) -> Floats:
        """Return encoders' angles of the motors' own places."""
        return positions * self.d.signs + self.d.zeros


@dataclass(frozen=True)
class Known:
    """What an owner knows of a hand: names, ranges [rad], arms and spools [m] of its drawings,
    motors' signs.
    """

    joints: tuple[str, ...]
    motors: tuple[str, ...]
    low: Floats
    high: Floats
    arms: Floats
    spools: Floats
    extra: dict[str, Any] = field(default_factory=dict)


ORCA = {
    "wrist": (-65, 35, 12.0, 1.0),
    "thumb_cmc": (-45, 33, 9.0, 0.74),
    "thumb_abd": (-18, 55, 9.0, 0.77),
    "thumb_mcp": (-25, 100, 7.0, 0.93),
    "thumb_dip": (-15, 107, 6.0, 0.8),
    "index_abd": (-25, 30, 7.0, 0.71),
    "index_mcp": (-25, 100, 8.0, 1.1),
    "index_pip": (-15, 107, 7.0, 1.05),
    "middle_abd": (-27, 27, 7.0, 0.88),
    "middle_mcp": (-25, 100, 8.0, 1.05),
    "middle_pip": (-15, 107, 7.0, 0.85),
    "ring_abd": (-27, 27, 7.0, 0.92),
    "ring_mcp": (-25, 100, 8.0, 1.14),
    "ring_pip": (-15, 107, 7.0, 0.92),
    "pinky_abd": (-30, 30, 7.0, 0.82),
    "pinky_mcp": (-25, 100, 7.0, 0.91),
    "pinky_pip": (-15, 107, 6.0, 0.95),
}
"""Range [deg], arm [mm], turns of the motor for one of the joint: of the size of a hand that can be
built today.
"""


def _uniform(
    rng: np.random.Generator, count: int, low: float, high: float, size: int | None = None
) -> Floats:
    return rng.uniform(low, high, count if size is None else size)


def _side_by_side(draws: list[dict[str, Any]], seed: int) -> Hands:
    return Hands(Drawn(**{key: np.array([draw[key] for draw in draws]) for key in draws[0]}), seed)


def orca_like(seeds: Any, joints: Sequence[str] = tuple(ORCA)) -> tuple[Known, Hands]:
    """Return what is known of a hand with a motor for each joint, and some such hands, a seed
    each.
    """
    table = np.array([ORCA[joint] for joint in joints])
    n = len(table)
    arm, ratio = 1e-3 * table[:, 2], table[:, 3]
    low, high = np.deg2rad(table[:, 0]), np.deg2rad(table[:, 1])
    known = Known(
        tuple(joints),
        tuple(f"m{i + 1}" for i in range(n)),
        low,
        high,
        np.vstack([np.diag(arm), -np.diag(arm)]),
        np.vstack([np.diag(arm / ratio), -np.diag(arm / ratio)]),
    )
    draws = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 171])
        u = partial(_uniform, rng, n)
        arms = arm * (1 + 0.02 * rng.normal(size=n))
        spool = arm / ratio * (1 + 0.02 * rng.normal(size=n))
        loose = rng.random(n) < 0.75
        pair = np.where(loose, u(0.1e-3, 0.8e-3), -u(0.02e-3, 0.2e-3))
        share = u(0.3, 0.7)
        draws.append(
            {
                "arms": np.vstack([np.diag(arms), -np.diag(arms)]),
                "spools": np.vstack([np.diag(spool), -np.diag(spool)]),
                "low": low + np.deg2rad(1.0) * rng.normal(size=n),
                "high": high + np.deg2rad(1.0) * rng.normal(size=n),
                "slack": np.concatenate([pair * share, pair * (1 - share)]),
                "stiffness": np.tile(u(1.2e4, 3e4), 2) * u(0.9, 1.1, 2 * n),
                "sheath": u(0.03, 0.25, 2 * n),
                "spring": u(0, 0.004),
                "rest": np.zeros(n),
                "dry": u(0.004, 0.012),
                "axle": u(0.03, 0.08),
                "weight": u(-0.003, 0.003),
                "gear_friction": u(0.02, 0.05),
                "gear_load": u(0.03, 0.1),
                "torque_constant": TORQUE_CONSTANT * (1 + 0.08 * rng.normal(size=n)),
                "zeros": rng.uniform(2.2, 4.0, n),
                "signs": np.where(rng.random(n) < 0.3, -1.0, 1.0),
            }
        )
    return known, _side_by_side(draws, int(next(iter(seeds))))


AERO_JOINTS = {
    "thumb_abd": (0, 100),
    "thumb_flex": (0, 55),
    "thumb_mcp": (0, 90),
    "thumb_ip": (0, 90),
    **{
        f"{finger}_{joint}": (0, 90)
        for finger in ("index", "middle", "ring", "pinky")
        for joint in ("mcp", "pip", "dip")
    },
}
"""Range [deg]."""

AERO_ARMS = {
    "thumb_abd": {"thumb_abd": 9.0},
    "thumb_flex": {"thumb_abd": 2.5, "thumb_flex": 12.5},
    "thumb_tendon": {"thumb_abd": 2.5, "thumb_flex": -2.5, "thumb_mcp": 9.5, "thumb_ip": 12.5},
    **{
        f: {f"{f}_mcp": 12.5, f"{f}_pip": 7.5, f"{f}_dip": 9.0}
        for f in ("index", "middle", "ring", "pinky")
    },
}
"""Motor → moment arms of its tendon [mm], of the size of a hand that can be built today."""


def aero_like(seeds: Any) -> tuple[Known, Hands]:
    """Return what is known of a hand whose fingers have one tendon each, and springs, and some such
    hands, a seed each.
    """
    joints, motors = tuple(AERO_JOINTS), tuple(AERO_ARMS)
    ends = np.deg2rad(np.array(list(AERO_JOINTS.values()), dtype=np.float64))
    arms = 1e-3 * np.array([[AERO_ARMS[m].get(j, 0.0) for j in joints] for m in motors])
    # the first motor turns its joint directly: a second tendon holds it the other way
    arms, n = np.vstack([arms, -arms[:1]]), len(joints)
    spools = 9e-3 * np.vstack([np.eye(len(motors)), -np.eye(len(motors))[:1]])
    known = Known(joints, motors, ends[:, 0], ends[:, 1], arms, spools)
    draws = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 172])
        u = partial(_uniform, rng, n)
        t, m = len(arms), len(motors)
        spring, slack = u(0.03, 0.07), u(0.0, 1e-3, t)
        spring[0], slack[0], slack[-1] = 0.0, 5e-5, 5e-5
        draws.append(
            {
                "arms": arms * (1 + 0.02 * rng.normal(size=arms.shape)),
                "spools": spools * (1 + 0.01 * rng.normal(size=(1, m))),
                "low": ends[:, 0] + np.deg2rad(1.0) * rng.normal(size=n),
                "high": ends[:, 1] + np.deg2rad(1.0) * rng.normal(size=n),
                "slack": slack,
                "stiffness": u(1.2e4, 3e4, t),
                "sheath": u(0.03, 0.2, t),
                "spring": spring,
                "rest": u(-0.5, -0.2),
                "dry": u(0.002, 0.006),
                "axle": u(0.03, 0.06),
                "weight": u(-0.002, 0.002),
                "gear_friction": u(0.02, 0.05, m),
                "gear_load": u(0.03, 0.1, m),
                "torque_constant": TORQUE_CONSTANT * (1 + 0.08 * rng.normal(size=m)),
                "zeros": rng.uniform(-0.1, 0.1, m),
                "signs": np.ones(m),
            }
        )
    return known, _side_by_side(draws, int(next(iter(seeds))) + 1)

"""The loop of orca_core on virtual encoders, on true ones, and on ratios of its motors, and that of
`distal.hands.Hand`: `python -m benchmarks.virtual_encoders [--hands N] [--first-seed N] [--off DEG]
[--faults N]`, where orca_core 0.12 is installed.

Its mock hand is moved by a plant of `strangers.servo_hands`: tendons with friction, slack and
stretch, ranges that are not those of the file. Time is simulated.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import logging
from types import SimpleNamespace
from typing import Any

import numpy as np
from tests.support.servo_hands import ORCA, PERIOD, orca_like

from benchmarks.report import table
from distal.bridges import orca as orca_bridge
from distal.bridges.orca import ANCHOR, VirtualEncoders
from distal.hands import Hand, RoutineOptions
from distal.rig import from_orca

MOTIONS, MOVES, RESTS = 8, 1.0, 1.0
"""Motions of a hand, how long each takes, and how long it stays there [s]."""

KINDS = ("nothing", "lost", "stale", "restart", "torn")
"""What goes wrong: nothing; reads are lost; none comes for a second; a motor counts from another
turn; a tendon tears."""


BEGINS = 450
"""Sample at which something goes wrong, after 1.5 s of motion and 3 s of rest."""

HELD = 200
"""Samples for which the pose is held after that; then all joints are asked to go to another one."""

SHARE = 0.9
"""Of a motor's travel between the ends, as the configuration has it, what turns the joint: this
plant's play and stretch take the rest."""


class Simulated:
    """A mock hand of orca_core whose motors a plant moves, and a clock."""

    def __init__(self, seed: int, off: float) -> None:
        from orca_core.hardware_hand import MockOrcaHand

        self.time = 100.0
        self.orca = MockOrcaHand()
        self.orca.connect()
        self.known, self.hands = orca_like([seed])
        joints = {motor: joint for joint, motor in self.orca.config.joint_to_motor_map.items()}
        self.joints = [joints[number] for number in self.orca.config.motor_ids]
        self.columns = np.array([self.known.joints.index(joint) for joint in self.joints])
        rng = np.random.default_rng([seed, 40])
        ranges = np.deg2rad([self.orca.config.joint_roms_dict[j] for j in self.known.joints])
        d = self.hands.d
        d.low[0], d.high[0] = (ranges + np.deg2rad(off) * rng.normal(size=ranges.shape)).T
        travels = self.orca.config.joint_motor_travel_v21_dict
        for k, joint in enumerate(self.known.joints):
            ratio = SHARE * np.deg2rad(travels[joint]) / np.ptp(ranges[k])
            d.spools[0, :, k] *= ORCA[joint][3] / ratio
        turned = self.orca.config.joint_inversion_dict
        d.signs[0] = [-1.0 if turned.get(joint, False) else 1.0 for joint in self.known.joints]
        self.goals = self.hands.goals_of(self.hands.positions)
        self.lost = False
        self.orca.write_motor_pos = self.write
        self.step()

    def write(self, numbers: Any, positions: Any) -> None:
        """Take goals of motors [rad]."""
        order = list(self.orca.config.motor_ids)
        for number, position in zip(numbers, positions):
            self.goals[0, self.columns[order.index(number)]] = position

    def step(self) -> None:
        """Let a period pass."""
        read = self.hands.step(self.goals)
        client = self.orca.motor_client
        self.time += PERIOD
        for number, j in zip(self.orca.config.motor_ids, self.columns):
            client._pos[number] = float(read["positions"][0, j])
            client._cur[number] = 1e3 * float(read["currents"][0, j])
        client.last_read_ok = not self.lost

    @property
    def clock(self) -> Any:
        """Return what stands for the module `time`."""

        def sleep(seconds: float) -> None:
            for _ in range(round(seconds / PERIOD)):
                self.step()

        return SimpleNamespace(monotonic=lambda: self.time, sleep=sleep)


class TrueEncoders:
    """Encoders in the joints; their anchor is the end of the range, as their own calibration finds
    it.
    """

    def __init__(self, hand: Simulated) -> None:
        from orca_core.hardware.sensing import constants

        self.hand = hand
        self.slots = [constants.JOINT_TO_ENCODER_SLOT[joint] for joint in hand.joints]
        signs = constants.joint_encoder_polarity_for_side(hand.orca.config.type)
        self.signs = np.array([signs[joint] for joint in hand.joints])

    def get_latest_unfiltered(self) -> Any:
        """Return a frame."""
        from orca_core.hardware.sensing import constants, types

        hands, turn = self.hand.hands, constants.ENCODER_COUNTS_PER_REV
        beyond = np.rad2deg(hands.angles - hands.d.high)[0, self.hand.columns]
        words = np.zeros(constants.AUTO_ENC_NUM_JOINTS, dtype=np.int64)
        counts = ANCHOR + np.round(self.signs * beyond / 360.0 * turn).astype(int)
        words[self.slots] = counts % turn
        right = np.zeros(len(words), dtype=bool)
        return types.EncoderReading(words.astype(np.uint16), ~right, right, 0, self.hand.time)


def calibrated(hand: Simulated) -> Any:
    """Run the power-on routine, give orca_core what its own calibration would find (limits and
    ratios of motors), and return the calibrated rig.
    """
    imported = from_orca(hand.orca.config.config_path)
    live = Hand(hand.orca, imported.rig)
    options = RoutineOptions(order=[imported.rig.drive_names])
    path: list[Any] = []
    clock = hand.clock

    def sleep(seconds: float) -> None:
        hand.step()
        path.append(hand.hands.goals_of(hand.hands.positions)[0].copy())

    found = live.power_on(options, PERIOD, sleep=sleep, now=clock.monotonic)
    limits, ratios = {}, {}
    for number, joint, j in zip(hand.orca.config.motor_ids, hand.joints, hand.columns):
        travel = np.array(path)[:, j]
        low, high = hand.orca.config.joint_roms_dict[joint]
        limits[number] = [float(travel.min()), float(travel.max())]
        ratios[number] = float(np.ptp(travel)) / (high - low)
    hand.orca.calibration = dataclasses.replace(
        hand.orca.calibration,
        motor_limits_dict=limits,
        joint_to_motor_ratios_dict=ratios,
        calibrated=True,
    )
    hand.orca._wrap_offsets_dict = dict.fromkeys(limits, 0.0)
    return found.rig


def asked(hand: Simulated, seed: int, motions: int) -> Any:
    """Return smooth motions between random angles of all joints [deg], (k, joints)."""
    rng = np.random.default_rng([seed, 41])
    low, high = np.array([hand.orca.config.joint_roms_dict[joint] for joint in hand.joints]).T
    poses = low + (high - low) * rng.uniform(0.1, 0.9, (motions + 1, len(low)))
    share = np.clip(np.arange(0, MOVES + RESTS, PERIOD) / MOVES, 0, 1)[:, None]
    smooth = share**2 * (3 - 2 * share)
    return np.vstack([a + smooth * (b - a) for a, b in itertools.pairwise(poses)])


def looped(hand: Simulated, rig: Any, widest: float) -> tuple[VirtualEncoders, Any]:
    """Return virtual encoders of a hand and orca_core's loop on them, ready to step."""
    from orca_core.control import joint_loop
    from orca_core.hardware.sensing import types

    vars(orca_bridge)["clock"] = joint_loop.time = types.time = hand.clock
    encoders = VirtualEncoders(hand.orca, rig, widest)
    encoders.connect()
    encoders.update()
    loop: Any = encoders.loop(target_hz=100)
    loop.prime_for_step()
    return encoders, loop


def followed(
    hand: Simulated, way: str, rig: Any, path: Any, widest: float = 30.0
) -> dict[str, Any]:
    """Let a hand follow a path by ratios, virtual or true encoders, or the loop of distal; return
    the true angles [deg], and with virtual ones whether each joint was valid, (k, joints).
    """
    from orca_core.calibration import JointEncoderCal
    from orca_core.control import joint_loop
    from orca_core.control.joint_controller import JointController
    from orca_core.hardware.sensing import types

    vars(orca_bridge)["clock"] = joint_loop.time = types.time = hand.clock
    orca, order, loop, encoders = hand.orca, hand.joints, None, None
    if way == "virtual":
        encoders, loop = looped(hand, rig, widest)
    elif way == "true":
        anchors = {joint: JointEncoderCal(ANCHOR) for joint in order}
        d = hand.hands.d
        spans = np.rad2deg(d.high - d.low)[0, hand.columns]
        ends = {joint: orca.config.joint_roms_dict[joint][1] for joint in order}
        orca.calibration = dataclasses.replace(
            orca.calibration,
            joint_encoder_calibration_dict=anchors,
            joint_roms_measured_dict={j: [ends[j] - s, ends[j]] for j, s in zip(order, spans)},
        )
        controller = JointController(len(order))
        slots = TrueEncoders(hand).slots
        gains = [orca.config.joint_gains_for(order[i]) for i in np.argsort(slots)]
        names = ("kp", "ki", "correction_max_deg")
        controller.set_gains(*(np.array([getattr(g, n) for g in gains]) for n in names))
        loop = joint_loop.JointLoopThread(orca, TrueEncoders(hand), controller, 100)
        loop.prime_for_step()
    own = Hand(orca, rig) if way == "distal" else None
    if own is not None:
        own.update(hand.time)
    angles, valid, said = [], [], []
    for wanted in path:
        targets = dict(zip(order, wanted.tolist()))
        if own is not None:
            own.set_joint_positions(targets)
            own.update(hand.time)
        elif loop is None:
            hand.write(orca.config.motor_ids, orca._joint_to_motor_pos(targets))
        else:
            loop.set_target({joint: targets[joint] for joint in loop.joint_names})
            if encoders is not None:
                encoders.update()
                frame: Any = encoders.get_latest()
                slots = [encoders._slots[joint] for joint in order]
                valid.append(
                    np.zeros(len(order), bool) if frame is None else ~frame.angle_error[slots]
                )
                now = encoders.hand.get_joint_positions()
                said.append([now[joint] for joint in order])
            loop.step_once(PERIOD)
        hand.step()
        angles.append(np.rad2deg(hand.hands.angles[0, hand.columns]))
    return {"angles": np.array(angles), "valid": np.array(valid), "said": np.array(said)}


def faulty(hand: Simulated, rig: Any, seed: int, episodes: int) -> list[tuple[Any, ...]]:
    """Let things go wrong while a hand holds poses, then moves; return of each episode what went
    wrong, by how much a joint goes away from its pose [deg], in how many samples of joints the
    error of the angle changed by more than 5°, in how many it is that large, and in how many of
    each it was not valid.
    """
    rng = np.random.default_rng([seed, 42])
    hands, found = hand.hands, []
    zeros = hands.d.zeros.copy()
    motors = list(hand.orca.config.motor_ids)
    encoders, loop = looped(hand, rig, 15.0)
    low, high = np.array([hand.orca.config.joint_roms_dict[joint] for joint in hand.joints]).T
    target = np.rad2deg(hands.angles[0, hand.columns])
    for _ in range(episodes):
        kind = str(rng.choice(KINDS))
        begin, target = target, low + (high - low) * rng.uniform(0.2, 0.8, len(low))
        one = int(rng.integers(len(motors)))
        j, moved, still = hand.columns[one], 0.0, None
        counts = np.zeros(4, dtype=int)
        looped_joints = set(loop.joint_names)
        rest = [m for m, joint in zip(motors, hand.joints) if joint not in looped_joints]
        poses = begin, target, low + (high - low) * rng.uniform(0.2, 0.8, len(low))
        for k in range(BEGINS + HELD + 250):
            leg = int(k >= BEGINS + HELD)
            share = min((k - leg * (BEGINS + HELD)) / 150, 1.0)
            wanted = poses[leg] + share**2 * (3 - 2 * share) * (poses[leg + 1] - poses[leg])
            boots = kind == "restart" and BEGINS <= k < BEGINS + 30
            is_stale = kind == "stale" and BEGINS <= k < BEGINS + 100
            is_lost = kind == "lost" and k >= BEGINS and rng.random() < 0.3
            hand.lost = boots or is_stale or is_lost
            if k == BEGINS and kind == "torn":
                hands.broken[0, j + int(rng.integers(2)) * len(hands.d.low[0])] = True
            if k == BEGINS and kind == "restart":
                hands.d.zeros[0, j] += 2 * np.pi
            targets = dict(zip(hand.joints, wanted.tolist()))
            goals = dict(zip(motors, hand.orca._joint_to_motor_pos(targets)))
            if k < BEGINS:
                hand.write(rest, [goals[motor] for motor in rest])
            loop.set_target({joint: targets[joint] for joint in loop.joint_names})
            encoders.update()
            loop.step_once(PERIOD)
            if boots:
                # it takes no goals, and then stands where it is
                hand.goals[0, j] = hands.goals_of(hands.positions)[0, j]
            hand.step()
            true = np.rad2deg(hands.angles[0, hand.columns])
            said = encoders.hand.get_joint_positions()
            error = np.array([said[joint] for joint in hand.joints]) - true
            if k == BEGINS:
                still, before = np.abs(true - target), error
            if still is not None:
                if leg == 0:
                    moved = max(moved, float((np.abs(true - target) - still).max()))
                frame: Any = encoders.get_latest()
                wrong = frame.angle_error[[encoders._slots[joint] for joint in hand.joints]]
                for at, far in enumerate((np.abs(error - before) > 5.0, np.abs(error) > 5.0)):
                    counts[2 * at : 2 * at + 2] += far.sum(), (far & wrong).sum()
        target = poses[2]
        found.append((kind, moved, *counts.tolist()))
        # repaired and calibrated anew
        hands.broken[:] = False
        hands.d.zeros[:] = zeros
        hand.goals = hands.goals_of(hands.positions)
        hand.lost = False
        hand.step()
        if kind in ("torn", "restart") or loop._stats["fallback_active"]:
            encoders, loop = looped(hand, rig, 15.0)
    return found


def rms(errors: Any) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(errors))))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hands", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=11000)
    parser.add_argument("--faults", type=int, default=0, help="episodes of each hand")
    told = "std by which the ends of ranges differ from those of the file [deg]"
    parser.add_argument("--off", type=float, default=2.0, help=told)
    arguments = parser.parse_args()
    logging.disable(logging.CRITICAL)
    if arguments.faults:
        found: list[tuple[Any, ...]] = []
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.hands):
            hand = Simulated(seed, arguments.off)
            found += faulty(hand, calibrated(hand), seed, arguments.faults)
        rows = []
        for kind in KINDS:
            of = [one for one in found if one[0] == kind]
            far = sum(one[1] > 3.0 for one in of)
            changed, not_valid, off, told = np.sum([one[2:] for one in of], axis=0)
            said = f"{not_valid} of {changed}", f"{told} of {off}"
            rows.append((kind, str(len(of)), str(far), *said))
        columns = (
            "",
            "episodes",
            "a joint leaves its pose by 3°",
            "not valid of those whose error changed by 5°",
            "of those with an error of 5°",
        )
        table("virtual_encoders_faults", "What goes wrong while a pose is held", columns, rows)
        return
    errors: dict[str, list[Any]] = {}
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.hands):
        for way in ("ratios", "virtual", "true", "distal"):
            hand = Simulated(seed, arguments.off)
            rig = calibrated(hand)
            path = asked(hand, seed, MOTIONS)
            begin = np.rad2deg(hand.hands.angles[0, hand.columns])
            lead = begin + np.linspace(0, 1, 100)[:, None] * (path[0] - begin)
            told = followed(hand, way, rig, np.vstack([lead, np.tile(path[0], (50, 1)), path]))
            at = slice(150, None)
            errors.setdefault(way, []).append(told["angles"][at] - path)
            if way == "virtual":
                errors.setdefault("estimate", []).append(told["said"][at] - told["angles"][at])
                print(seed, f"valid {np.mean(told['valid'][at]):.3f}")
            print(seed, way, f"{rms(errors[way][-1]):.2f}")
    still = np.arange(len(path)) % round((MOVES + RESTS) / PERIOD) >= (MOVES + RESTS / 2) / PERIOD
    rows = [
        (way, f"{rms(np.vstack(of)):.2f}", f"{rms(np.vstack([one[still] for one in of])):.2f}")
        for way, of in errors.items()
    ]
    title = "Joints beside what was asked"
    table("virtual_encoders", title, ("", "RMS [deg]", "at rest [deg]"), rows)


if __name__ == "__main__":
    main()

"""Joint encoders for ORCA hands that have none: `orca_core` reads estimates as it reads encoders.

`VirtualEncoders` has the methods of `orca_core`'s `JointEncoderClient` (0.12), so that its closed
loop (`JointLoopThread`) runs on it unchanged.
"""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from distal.confidence import BAND
from distal.errors import EstimationError
from distal.hands import Hand
from distal.rig import Rig

if TYPE_CHECKING:
    from orca_core.control.joint_loop import JointLoopThread
    from orca_core.hardware.joint_encoder_client import EncoderStreamStats
    from orca_core.hardware.sensing.types import EncoderReading

ANCHOR = 1 << 13
"""Count of a joint at the upper end of its range. Source: definition (any number would do)."""

BRIDGED = 1.0
"""Time without a reading for which frames go on [s]. Source: definition (orca_core's watchdog)."""


class VirtualEncoders:
    """Joint encoders of an ORCA hand that has none: its motors are read, the joints' angles
    estimated, and told as counts (docs/how-to/orca-encoders.md).

    A joint is *not valid* where half its 95 % band is wider than `widest`, where a sensor or tendon
    of one of its motors is in doubt (`Reading.doubted`), or where a motor restarted. While no motor
    answers, the frames of the filter's prediction go on for `BRIDGED`, with no joint valid; then
    they cease, which the loop's watchdog sees.

    Args:
        orca_hand: an `orca_core.OrcaHand`, connected without feedback.
        rig: of that hand, after its power-on routine (`distal calibrate`).
        widest: half of a band, above which an angle is not valid [deg].
        period: between readings [s].

    Attributes:
        is_connected: whether `connect` was called, and `disconnect` was not.

    Raises:
        EstimationError: the hand is of another kind, or none of its joints is one of the rig.
        RigError: the rig is unknown or wrong.
    """

    def __init__(
        self,
        orca_hand: object,
        rig: Rig | str | Path,
        widest: float = 15.0,
        period: float = 0.01,
        compiled: bool = True,
    ) -> None:
        self.hand = Hand(orca_hand, rig, compiled=compiled)
        self._orca: Any = orca_hand
        self._widest = widest
        self._period = period
        self._wire = import_module("orca_core.hardware.sensing.constants")
        slots = self._wire.JOINT_TO_ENCODER_SLOT
        self._slots = {name: slots[name] for name in self.hand.rig.joint_names if name in slots}
        if not self._slots:
            raise EstimationError(
                f"no joint of '{self.hand.rig.name}' is one of an ORCA hand: {', '.join(slots)}"
            )
        self._motors_of = {
            joint: {t.drive for t in self.hand.rig.tendons if joint in t.joints}
            for joint in self._slots
        }
        self._stopping = threading.Event()
        self._came = threading.Event()
        self._thread: threading.Thread | None = None
        self._frame: EncoderReading | None = None
        self._frames = 0
        self.is_connected = False
        self._read_at = -inf
        self._restarted = set[str]()
        self._zeros = dict[str, float]()
        self._doubted = set[str]()

    def connect(self) -> None:
        """Give the hand the calibration of these encoders."""
        anchor = import_module("orca_core.calibration").JointEncoderCal(ANCHOR)
        anchors = dict.fromkeys(self._slots, anchor)
        was = self._orca.calibration
        self._orca.calibration = replace(was, joint_encoder_calibration_dict=anchors)
        self.is_connected = True

    def disconnect(self) -> None:
        """End the stream."""
        self.stop_stream()
        self.is_connected = False

    def start_stream(self, timeout: float = 5.0) -> None:
        """Begin to read the motors, and wait for the first frame.

        Raises:
            OSError: `connect` was not called.
            EstimationError: no frame came within the `timeout` [s].
        """
        if not self.is_connected:
            raise OSError("call connect() first")
        if self._thread is None or not self._thread.is_alive():
            self._stopping.clear()
            self._thread = threading.Thread(target=self._run, name="VirtualEncoders", daemon=True)
            self._thread.start()
        if not self._came.wait(timeout):
            self.stop_stream()
            raise EstimationError(f"no angle within {timeout:g} s: {self.hand.health().sentence}")

    def stop_stream(self) -> None:
        """End the readings; there is no latest frame then."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
        self._frame = None
        self._came.clear()

    def _run(self) -> None:
        due = clock.monotonic()
        while not self._stopping.is_set():
            self.update()
            due = max(due + self._period, clock.monotonic())
            self._stopping.wait(due - clock.monotonic())

    def update(self) -> None:
        """Read the motors once, and make a frame of the estimate; the stream does so by itself."""
        now = clock.monotonic()
        reading = self.hand.update(now)
        health = self.hand.health()
        if len(health.silent) < len(self.hand.rig.drives):
            self._read_at = now
        zeros = self.hand.zeros
        turned = (name for name, was in self._zeros.items() if abs(zeros[name] - was) > 1.0)
        self._restarted.update(self.hand.restarted, turned)
        self._doubted = self._restarted.union(health.silent, reading.doubted)
        if now - self._read_at > BRIDGED or not any(map(isfinite, reading.angles)):
            return
        wire = self._wire
        words = np.full(wire.AUTO_ENC_NUM_JOINTS, wire.AUTO_ENC_ANGLE_ERROR_BIT, dtype=np.int64)
        angles = self.hand.get_joint_positions()
        stds = self.hand.get_joint_stds()
        signs = wire.joint_encoder_polarity_for_side(self._orca.config.type)
        ranges = self._orca.effective_joint_roms_dict
        for joint, slot in self._slots.items():
            if isfinite(angles[joint]):
                turns = signs[joint] * (angles[joint] - ranges[joint][1]) / 360.0
                count = ANCHOR + round(turns * wire.ENCODER_COUNTS_PER_REV)
                words[slot] = count % wire.ENCODER_COUNTS_PER_REV
                is_narrow = BAND * stds[joint] <= self._widest
                if not (is_narrow and self._motors_of[joint].isdisjoint(self._doubted)):
                    words[slot] |= wire.AUTO_ENC_ANGLE_ERROR_BIT
        words |= wire.AUTO_ENC_PARITY_BIT * (np.array([int(w).bit_count() for w in words]) % 2)
        self._frame = import_module("orca_core.hardware.sensing.types").EncoderReading(
            raw_counts=words.astype(np.uint16),
            parity_ok=np.ones(len(words), dtype=np.bool_),
            angle_error=(words & wire.AUTO_ENC_ANGLE_ERROR_BIT) != 0,
            error_byte=0,
            timestamp=now,
        )
        self._frames += 1
        self._came.set()

    def _valid(self) -> list[str]:
        """Return the joints that are valid in the latest frame, in the order of its counts."""
        frame = self._frame
        ordered = sorted(self._slots, key=self._slots.__getitem__)
        return [j for j in ordered if frame is not None and not frame.angle_error[self._slots[j]]]

    def get_latest(self) -> EncoderReading | None:
        """Return the latest frame; None before the first, and where the stream was stopped."""
        return self._frame

    get_latest_unfiltered = get_latest

    def get_stats(self) -> EncoderStreamStats:
        """Return how many frames there were."""
        client = import_module("orca_core.hardware.joint_encoder_client")
        stamp = None if self._frame is None else self._frame.timestamp
        return client.EncoderStreamStats(frames_ok=self._frames, last_frame_timestamp=stamp)

    def loop(self, target_hz: int = 200, timeout: float = 5.0) -> JointLoopThread:
        """Return `orca_core`'s closed loop on these encoders, with the gains of its configuration,
        to be started, with `target_hz` cycles a second. It closes on the joints that are valid now;
        move others by their motors until they are.

        Its controller is `orca_core`'s too, but for joints that are not valid: they keep the
        correction that they had, since the error that they had last would be integrated for ever.

        Raises:
            EstimationError: no joint is valid within the `timeout` [s].
        """
        control = import_module("orca_core.control.joint_controller")
        until = clock.monotonic() + timeout
        while not (order := self._valid()) and clock.monotonic() < until:
            clock.sleep(self._period)
        if not order:
            stds = self.hand.get_joint_stds()
            bands = ", ".join(f"{joint} ± {BAND * stds[joint]:.3g}°" for joint in self._slots)
            raise EstimationError(
                f"no joint is valid within {timeout:g} s: {self.hand.health().sentence}; bands "
                f"count up to ± {self._widest:g}° (widest): {bands}"
            )
        slots = [self._slots[joint] for joint in order]
        encoders = self

        class Holding(control.JointController):  # type: ignore[misc, name-defined]
            """The controller that keeps the correction of joints that are not valid."""

            def step(self, target_deg: Any, measured_deg: Any, dt: float) -> Any:
                latest = encoders._frame
                held = latest is not None and latest.angle_error[slots]
                was = self.get_state()
                new = super().step(target_deg, measured_deg, dt)
                with self._lock:
                    self._ierr = np.where(held, was["ierr_deg"], self.__dict__["_ierr"])
                    self._last_correction = np.where(held, was["last_correction_deg"], new)
                    return self._last_correction.copy()

        if self._orca._wrap_offsets_dict is None:
            self._orca._compute_wrap_offsets_dict()
        gains = [self._orca.config.joint_gains_for(joint) for joint in order]
        controller = Holding(len(order))
        names = ("kp", "ki", "correction_max_deg")
        controller.set_gains(*(np.array([getattr(g, name) for g in gains]) for name in names))
        self._restarted.clear()
        self._zeros = self.hand.zeros
        threads = import_module("orca_core.control.joint_loop")
        return threads.JointLoopThread(_Barring(self), self, controller, target_hz, order)


class _Barring:
    """The hand as the loop sees it: a motor in doubt gets no goal and stays where it was sent last,
    one that restarted for ever, since the loop's goals count from another turn.
    """

    def __init__(self, encoders: VirtualEncoders) -> None:
        self._encoders = encoders

    def __getattr__(self, name: str) -> Any:
        return getattr(self._encoders._orca, name)

    def write_motor_pos(self, motor_ids: Sequence[int], positions: Sequence[float]) -> None:
        """Send goals [rad] to the motors that are not in doubt."""
        barred = self._encoders._doubted
        sent = {n: at for n, at in zip(motor_ids, positions) if f"motor_{n}" not in barred}
        self._encoders._orca.write_motor_pos(list(sent), list(sent.values()))

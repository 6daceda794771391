"""Virtual encoders of an ORCA hand: counts that decode to the estimate, joints that are not valid,
frames that cease. `orca_core` itself is too heavy for tests: `benchmarks.virtual_encoders` runs its
loop.
"""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import distal.bridges.orca as bridge
from distal.errors import EstimationError
from tests.hands.test_hand import Orca, renamed, sound_rig

SLOTS = {"index_mcp": 5, "ring_abd": 12, "wrist": 16}
SIGNS = {"index_mcp": 1, "ring_abd": -1, "wrist": -1}
RANGES = {"index_mcp": [-25.0, 100.0], "ring_abd": [-27.0, 27.0]}


@dataclass(frozen=True)
class Calibration:
    joint_encoder_calibration_dict: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Anchor:
    enc_at_anchor_count: int


class Controller:
    """Integrates errors, as the SDK's does."""

    def __init__(self, size: int) -> None:
        self._lock = threading.Lock()
        self._ierr = self._last_correction = np.zeros(size)
        self.gains: tuple[Any, ...] = ()

    def set_gains(self, *gains: Any) -> None:
        self.gains = gains

    def get_state(self) -> dict[str, Any]:
        return {"ierr_deg": self._ierr, "last_correction_deg": self._last_correction}

    def step(self, target: Any, measured: Any, dt: float) -> Any:
        self._ierr = self._ierr + dt * (target - measured)
        self._last_correction = self._ierr.copy()
        return self._ierr.copy()


class Loop:
    def __init__(self, hand: Any, client: Any, controller: Any, *options: Any) -> None:
        self.hand, self.client, self.controller, self.options = hand, client, controller, options


class Clock:
    now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Stand in for the SDK's modules and for time."""

    def module(name: str, **parts: Any) -> None:
        made = ModuleType(name)
        made.__dict__.update(parts)
        monkeypatch.setitem(sys.modules, name, made)

    def polarity(side: str) -> dict[str, int]:
        return SIGNS

    packages = ("hardware", "hardware.sensing", "control")
    for name in ("orca_core", *(f"orca_core.{package}" for package in packages)):
        module(name)
    module(
        "orca_core.hardware.sensing.constants",
        JOINT_TO_ENCODER_SLOT=SLOTS,
        joint_encoder_polarity_for_side=polarity,
        AUTO_ENC_NUM_JOINTS=17,
        AUTO_ENC_ANGLE_ERROR_BIT=1 << 14,
        AUTO_ENC_PARITY_BIT=1 << 15,
        ENCODER_COUNTS_PER_REV=1 << 14,
    )
    module("orca_core.hardware.sensing.types", EncoderReading=SimpleNamespace)
    module("orca_core.hardware.joint_encoder_client", EncoderStreamStats=SimpleNamespace)
    module("orca_core.calibration", JointEncoderCal=Anchor)
    module("orca_core.control.joint_controller", JointController=Controller)
    module("orca_core.control.joint_loop", JointLoopThread=Loop)
    clock = Clock()
    monkeypatch.setattr(bridge, "clock", clock)
    return clock


class Hand(Orca):
    """The hand of `test_hand`, with what a loop asks of it."""

    def __init__(self) -> None:
        super().__init__()
        self.calibration = Calibration()
        self.effective_joint_roms_dict = RANGES
        self.config.type = "right"
        self.config.joint_gains_for = lambda joint: SimpleNamespace(
            kp=0.5, ki=2.0, correction_max_deg=15.0
        )
        self._wrap_offsets_dict: dict[int, float] | None = None

    def _compute_wrap_offsets_dict(self) -> None:
        self._wrap_offsets_dict = {1: 0.0, 2: 0.0}


def encoders_of(hand: Hand, widest: float = 30.0) -> bridge.VirtualEncoders:
    encoders = bridge.VirtualEncoders(hand, sound_rig(), widest, compiled=False)
    encoders.connect()
    return encoders


def moved(encoders: bridge.VirtualEncoders, hand: Hand, clock: Clock, steps: int = 40) -> None:
    for k in range(steps):
        hand.positions[:] = min(0.02 * k, 0.5)
        read(encoders, hand, clock)


def read(encoders: bridge.VirtualEncoders, hand: Hand, clock: Clock, times: int = 1) -> None:
    """Let some periods pass; currents have the noise of sensors."""
    for _ in range(times):
        clock.now += 0.01
        hand.currents = 5.0 * np.sin(1e4 * clock.now + np.arange(2))
        encoders.update()


def decoded(frame: Any, joint: str) -> float:
    """Return an angle as the SDK decodes it: counts from the anchor, at the range's upper end."""
    delta = ((int(frame.raw_counts[SLOTS[joint]]) & 0x3FFF) - bridge.ANCHOR) * 360.0 / 16384
    delta = delta - 360.0 if delta > 180.0 else delta + 360.0 if delta <= -180.0 else delta
    return SIGNS[joint] * delta + RANGES[joint][1]


def test_counts_decode_to_the_estimate(clock: Clock) -> None:
    hand = Hand()
    encoders = encoders_of(hand)
    assert hand.calibration.joint_encoder_calibration_dict["ring_abd"] == Anchor(bridge.ANCHOR)
    assert encoders.get_latest() is None
    moved(encoders, hand, clock)
    frame = encoders.get_latest_unfiltered()
    assert frame is not None
    for joint, angle in encoders.hand.get_joint_positions().items():
        assert decoded(frame, joint) == pytest.approx(angle, abs=0.012)
        assert not frame.angle_error[SLOTS[joint]]
    assert frame.angle_error[SLOTS["wrist"]]  # the rig has none
    ones = [int(word).bit_count() for word in frame.raw_counts]
    assert all(count % 2 == 0 for count in ones)
    assert frame.parity_ok.all()
    assert frame.timestamp == clock.now
    assert vars(encoders.get_stats()) == {"frames_ok": 40, "last_frame_timestamp": clock.now}


def test_a_wide_band_is_not_valid(clock: Clock) -> None:
    hand = Hand()
    encoders = encoders_of(hand, widest=1e-3)
    moved(encoders, hand, clock, 5)
    frame = encoders.get_latest()
    assert frame is not None
    assert frame.angle_error.all()


def test_without_readings_no_joint_is_valid_and_frames_cease_after_a_second(clock: Clock) -> None:
    hand = Hand()
    encoders = encoders_of(hand)
    moved(encoders, hand, clock)
    hand.fails = True
    read(encoders, hand, clock)
    frame = encoders.get_latest()
    assert frame is not None
    assert frame.timestamp == clock.now
    assert frame.angle_error.all()
    read(encoders, hand, clock, 150)
    frame = encoders.get_latest()
    assert frame is not None
    assert 0.4 < clock.now - frame.timestamp < 0.6
    hand.fails = False
    read(encoders, hand, clock)
    frame = encoders.get_latest()
    assert frame is not None
    assert frame.timestamp == clock.now


def test_a_joint_that_is_not_valid_keeps_its_correction(clock: Clock) -> None:
    hand = Hand()
    encoders = encoders_of(hand)
    begun = clock.now
    with pytest.raises(EstimationError, match=r"within 2 s: .* up to ± 30° .*: index_mcp ± "):
        encoders.loop(timeout=2.0)
    assert clock.now - begun == pytest.approx(2.0, abs=0.02)
    moved(encoders, hand, clock)
    loop = encoders.loop(target_hz=100)
    assert loop.options == (100, ["index_mcp", "ring_abd"])
    assert [gain.tolist() for gain in loop.controller.gains] == [[0.5] * 2, [2.0] * 2, [15.0] * 2]
    target, measured = np.array([3.0, 5.0]), np.zeros(2)
    for _ in range(10):
        correction = loop.controller.step(target, measured, 0.1)
    np.testing.assert_allclose(correction, [3.0, 5.0])
    hand.fails = True
    read(encoders, hand, clock)
    for _ in range(10):
        np.testing.assert_array_equal(loop.controller.step(target, measured, 0.1), correction)
    hand.fails = False
    read(encoders, hand, clock)
    np.testing.assert_allclose(loop.controller.step(target, measured, 0.1), 1.1 * correction)


@pytest.mark.parametrize("is_said", [True, False])
def test_a_motor_that_restarted_gets_no_goal_of_the_loop(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, is_said: bool
) -> None:
    """Also where it is told by its turn alone."""
    hand = Hand()
    if not is_said:
        monkeypatch.setattr(bridge.Hand, "restarted", ())
    encoders = encoders_of(hand)
    moved(encoders, hand, clock)
    loop: Any = encoders.loop()
    loop.hand.write_motor_pos([1, 2], [0.5, 0.5])
    assert hand.sent == {1: 0.5, 2: 0.5}
    assert loop.hand.config is hand.config
    clock.now += 1.0  # it was silent, and then counts from another turn
    hand.positions[1] += 2 * np.pi
    read(encoders, hand, clock, 5)
    loop.hand.write_motor_pos([1, 2], [0.4, 0.4])
    assert hand.sent == {1: 0.4}
    frame: Any = encoders.get_latest()
    assert frame.angle_error[SLOTS["ring_abd"]]
    assert not frame.angle_error[SLOTS["index_mcp"]]


def test_the_stream_reads_by_itself(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    import time

    monkeypatch.setattr(bridge, "clock", time)
    hand = Hand()
    encoders = bridge.VirtualEncoders(hand, sound_rig(), compiled=False)
    with pytest.raises(OSError, match="connect"):
        encoders.start_stream()
    encoders.connect()
    assert encoders.is_connected
    encoders.start_stream()
    encoders.start_stream()  # it goes on
    assert encoders.get_latest() is not None
    assert encoders._thread is not None
    encoders._stopping.set()
    encoders._thread.join()  # its thread has ended
    encoders.start_stream()
    assert encoders._thread.is_alive()
    encoders.disconnect()
    assert encoders.get_latest() is None
    assert not encoders.is_connected
    hand.fails = True
    encoders = bridge.VirtualEncoders(hand, sound_rig(), compiled=False)
    encoders.connect()
    with pytest.raises(EstimationError, match="no answer from motor_1, motor_2"):
        encoders.start_stream(timeout=0.2)


def test_a_hand_of_other_joints_is_refused(clock: Clock) -> None:
    from tests.support.hands import rig_of
    from tests.support.servo_hands import orca_like

    known, _ = orca_like([3], ("thumb_cmc", "thumb_mcp"))
    with pytest.raises(EstimationError, match="is one of an ORCA hand: index_mcp"):
        bridge.VirtualEncoders(Hand(), renamed(rig_of(known)), compiled=False)


@pytest.mark.more  # orca_core itself, a minute in real time
def test_the_mock_hand_of_the_example_follows_its_goals() -> None:
    pytest.importorskip("orca_core")
    example = Path(__file__).parents[2] / "examples" / "hands" / "orca_mock_hand.py"
    with TemporaryDirectory() as folder:
        done = subprocess.run([sys.executable, example], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert (Path(folder) / "calibrated.toml").is_file()
    said = re.search(r"'index_mcp': ([0-9.]+)", done.stdout)
    assert said is not None
    assert float(said[1]) == pytest.approx(40.0, abs=3.0)

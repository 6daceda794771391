"""The limits on both sides: the same filter written by hand in C, and as a user writes it with
FilterPy and NumPy.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from distal import Log, estimate_batch, make_estimator
from distal.estimators import KernelEstimator
from distal.kernels import find_compiler
from distal.kernels.compiler import FLAGS, OPTIMISED, Compiler
from distal.rig import Rig
from distal.run import LiveEstimator, samples_of

HANDWRITTEN = Path(__file__).parent / "handwritten" / "ekf.c"
REPEATS = 25


def scan_time(
    estimator: KernelEstimator, log: Log, summary: Callable[[list[float]], float] = np.median
) -> float:
    """Return the time per sample of a whole log's loop in C [µs], the median of some repeats."""
    samples = samples_of(log, estimator.channels)
    rows, _ = estimator.checked_rows(estimator.initial(log.time[0], samples[0]), log.time, samples)
    kernel_state = estimator.initial(log.time[0], samples[0]).kernel_state
    scan = estimator.kernel.scan
    return _timed(lambda: scan(kernel_state, rows, estimator.parameters), summary) / len(rows)


def build(compiler: Compiler, source: Path, library: Path) -> None:
    """Compile a rival as a person would: for this processor, with full optimisation."""
    command = [*compiler.command, OPTIMISED, *FLAGS, str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)


def handwritten_time(rig: Rig, log: Log) -> tuple[float, float]:
    """Return the time per sample of the hand-written `ekf` [µs], and its largest difference to the
    compiled one [rad].
    """
    compiler = find_compiler()
    assert not isinstance(compiler, str)
    estimator = make_estimator("ekf", rig)
    samples = samples_of(log, estimator.channels)
    start = estimator.initial(log.time[0], samples[0])
    rows, _ = estimator.checked_rows(start, log.time, samples)
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "ekf.so"
        build(compiler, HANDWRITTEN, library)
        scan = ctypes.CDLL(str(library)).ekf_scan
        arrays = [
            np.array(start.kernel_state),
            np.ascontiguousarray(rows),
            np.array(estimator.parameters),
        ]
        arrays += [np.zeros((len(rows), 44)), np.zeros((len(rows), 4))]
        arguments = [
            ctypes.c_longlong(len(rows)),
            *(ctypes.c_void_p(array.ctypes.data) for array in arrays),
        ]
        taken = _timed(lambda: scan(*arguments)) / len(rows)
        known, _ = estimator.kernel.scan(start.kernel_state, rows, estimator.parameters)
    return taken, float(np.abs(arrays[3][:, 0] - known[:, 0]).max())


def _timed(
    call: Callable[[], object], summary: Callable[[list[float]], float] = np.median
) -> float:
    """Return the median time of a call, or another summary of its times [µs]."""
    taken = []
    for _ in range(REPEATS):
        start = time.perf_counter_ns()
        call()
        taken.append((time.perf_counter_ns() - start) / 1e3)
    return float(summary(taken))


def live_times(rig: Rig, log: Log, name: str = "adaptive") -> np.ndarray:
    """Return the times of `LiveEstimator.step` in a Python loop [µs]."""
    live = LiveEstimator(rig, name)
    samples, stamps = samples_of(log, live.channels), [float(t) for t in log.time]
    taken = []
    for repeat in range(5):
        live.reset()
        for stamp, sample in zip(stamps, samples):
            start = time.perf_counter_ns()
            live.step(stamp, sample)
            if repeat:
                taken.append(time.perf_counter_ns() - start)
    return np.array(taken) / 1e3


def batch_time(rig: Rig, logs: list[Log], runs: int, workers: int | None) -> float:
    """Return the time per sample and run of a batch [µs], from logs in memory to estimates that are
    let go.
    """
    start, samples = time.perf_counter(), 0
    for result in estimate_batch((logs[i % len(logs)] for i in range(runs)), rig, workers=workers):
        samples += len(result)
    return (time.perf_counter() - start) / samples * 1e6


def numpy_substeps(states: np.ndarray, pulls: np.ndarray, dt: float, count: int = 15) -> np.ndarray:
    """Return states of the paper's rig after an interval, (m, 6), by sub-steps in NumPy with
    projected friction.

    As a careful user writes it: all perturbed states at once, one array operation per line of the
    equations.
    """
    inertia, damping = np.array([4.239e-4, 1e-3, 1e-3]), np.array([8e-3, 0.01, 0.01])
    r, length, k, mu, r_a, preload, mu_x = 9.53e-3, 0.375, 806.0, 0.5, 3.18e-3, 4.9, 2e-3
    low, high = np.array([-0.005, -0.012]), np.array([0.02, 0.013])
    side, h = np.array([1.0, -1.0]), dt / count
    q, v = states[:, :3].copy(), states[:, 3:].copy()
    for i in range(count + 1):
        step = h / 2 if i in (0, count) else h
        a = np.exp(-damping * step / inertia)
        b = (1 - a) / damping
        sine, cosine = np.sin(q[:, :1]), np.cos(q[:, :1])
        along, across = length + q[:, 1:] - side * r * sine, r * (1 - cosine)
        whole = np.hypot(across, along)
        tension = k * np.maximum(whole - length, 0.0)
        torque = -np.sum((across * r * sine - along * side * r * cosine) / whole * tension, axis=1)
        force = np.column_stack([torque, pulls - along / whole * tension])
        limit = b * np.column_stack([mu * r_a * (preload + tension.sum(axis=1)), mu_x * tension])
        z = a * v + b * force
        v = np.sign(z) * np.maximum(np.abs(z) - limit, 0.0)
        end = q[:, 1:] + h * v[:, 1:]
        position = np.clip(end, low, high)
        inside = (end - position) * (1e5 * (end - position) + 3.0 * v[:, 1:]) > 0
        pressed = z[:, 1:] - b[1:] * 1e5 * (q[:, 1:] - position)
        pressed = (
            np.sign(pressed)
            * np.maximum(np.abs(pressed) - limit[:, 1:], 0.0)
            / (1 + b[1:] * (1e5 * h + 3.0))
        )
        v[:, 1:] = np.where(inside, pressed, v[:, 1:])
        if i < count:
            q = q + h * v
    return np.hstack([q, v])


def filterpy_numpy(samples: np.ndarray, times: np.ndarray, count: int) -> np.ndarray:
    """Return the times per step [µs] of FilterPy's EKF on `numpy_substeps`, its Jacobian by
    differences, all at once.
    """
    from filterpy.kalman import ExtendedKalmanFilter

    peer = ExtendedKalmanFilter(dim_x=6, dim_z=2)
    peer.x = np.array([-0.436, samples[0, 0], samples[0, 1], 0, 0, 0])
    peer.P, peer.R, peer.Q = np.eye(6), 1e-9 * np.eye(2), 1e-3 * np.eye(6)
    jacobian, nudges = np.eye(6)[1:3], np.vstack([np.zeros(6), 1e-6 * np.eye(6)])
    taken = []
    for k in range(1, count):
        start = time.perf_counter_ns()
        ends = numpy_substeps(peer.x + nudges, samples[k, 2:], times[k] - times[k - 1])
        peer.F = (ends[1:] - ends[0]).T / 1e-6
        peer.P = peer.F @ peer.P @ peer.F.T + peer.Q
        peer.x = ends[0]
        peer.update(samples[k, :2], lambda x: jacobian, lambda x: x[1:3])
        taken.append((time.perf_counter_ns() - start) / 1e3)
    return np.array(taken)

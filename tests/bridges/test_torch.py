"""Many estimators step by step: what each says is what `estimate` says of its log."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from distal import Log, estimate, load_rig, make_estimator, simulate
from distal.arrays import Floats
from distal.bridges import torch
from distal.bridges.torch import Angles, BatchEstimator, cuda_source
from distal.errors import EstimationError

N = 5
"""Estimators: with four lanes or eight the last group is not full."""


def logs(name: str, samples: int = 40) -> list[Log]:
    rig = load_rig(name)
    if name in ("da-vinci-grasper", "wrist-instrument"):  # their drives swing
        time = np.arange(samples) * 0.01
        channels = make_estimator(None, rig).channels
        swings = [{each: 0.1 * np.sin((3 + k) * time) for each in channels} for k in range(N)]
        return [Log(time, swing) for swing in swings]
    scenario = {"finger-2n": "finger"}.get(name, name)
    return [simulate(rig, scenario, seed).select(slice(300, 300 + samples)) for seed in range(N)]


def values(estimator: BatchEstimator, of: list[Log], k: int) -> Floats:
    return np.array([[log.channels[name][k] for name in estimator.channels] for log in of])


def run(estimator: BatchEstimator, of: list[Log]) -> list[Angles]:
    steps = np.diff(of[0].time, prepend=of[0].time[0] - 0.01)
    return [estimator.step(float(dt), values(estimator, of, k)) for k, dt in enumerate(steps)]


@pytest.mark.parametrize(
    ("name", "compiled"),
    [
        ("lab-bench", True),
        ("lab-bench", False),
        ("wrist-instrument", False),  # several joints
        ("da-vinci-grasper", False),  # a learned map
        pytest.param("finger-2n", True, marks=pytest.mark.slow),
    ],
)
def test_each_says_what_estimate_says(
    name: str, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setenv("DISTAL_COMPILE", "0")
    rig = load_rig(name)
    of = logs(name)
    found = run(BatchEstimator(rig, N), of)
    for k, log in enumerate(of):
        alone = estimate(log, rig)
        assert np.array([each.angles[k] for each in found]) == pytest.approx(
            alone.angles.reshape(len(log.time), -1), abs=1e-12
        )
        assert np.array([each.stds[k] for each in found]) == pytest.approx(
            alone.angle_stds.reshape(len(log.time), -1), abs=1e-12
        )
    assert not any(each.restarted.any() for each in found)


def test_gaps_and_missing_values_are_bridged_as_in_a_log() -> None:
    rig = load_rig("lab-bench")
    of = []
    for log in logs("lab-bench"):
        angle = log.channels["motor_angle"].copy()
        angle[5:8] = np.nan
        gone = Log(log.time, dict(log.channels) | {"motor_angle": angle})
        of.append(gone.select(np.r_[0:20, 27:40]))
    found = run(BatchEstimator(rig, N), of)
    for k, log in enumerate(of):
        assert np.array([each.angles[k, 0] for each in found]) == pytest.approx(
            estimate(log, rig).angles[:, 0], abs=1e-12
        )


def test_only_those_that_are_reset_begin_anew() -> None:
    of = logs("lab-bench")
    estimator = BatchEstimator("lab-bench", N)
    run(estimator, of)
    kept = estimator.step(0.01, values(estimator, of, -1))
    run(estimator, of)
    estimator.reset([1, 3])
    found = estimator.step(0.01, values(estimator, of, -1))
    fresh = BatchEstimator("lab-bench", N).step(0.01, values(estimator, of, -1))
    assert found.angles[[1, 3]] == pytest.approx(fresh.angles[[1, 3]], abs=0)
    assert found.angles[[0, 2, 4]] != pytest.approx(fresh.angles[[0, 2, 4]], abs=1e-6)
    mask = np.ones(N, dtype=bool)
    estimator.reset(mask)
    again = run(estimator, of)
    assert again[-1].angles == pytest.approx(
        run(BatchEstimator("lab-bench", N), of)[-1].angles, abs=0
    )
    assert kept.angles.shape == (N, 1)


def test_one_that_begins_has_no_gap_behind_it() -> None:
    first, later = logs("lab-bench"), BatchEstimator("lab-bench", N)
    at_once = BatchEstimator("lab-bench", N)
    for k, dt in enumerate((0.01, 0.01)):
        found = later.step(0.05 if k == 0 else dt, values(later, first, k))
        expected = at_once.step(dt, values(at_once, first, k))
        assert found.angles == pytest.approx(expected.angles, abs=0)
        assert found.stds == pytest.approx(expected.stds, abs=0)


def test_one_that_leaves_all_bounds_begins_anew_and_the_others_go_on() -> None:
    of = logs("lab-bench")
    estimator = BatchEstimator("lab-bench", N)
    run(estimator, of)
    kernel_state = estimator._arrays[0]
    kernel_state[0, 0, 2] = np.inf
    found = estimator.step(0.01, values(estimator, of, -1))
    assert found.restarted.tolist() == [False, False, True, False, False]
    after = estimator.step(0.01, values(estimator, of, -1))
    assert not after.restarted.any()
    assert np.isfinite(after.angles).all()


def test_what_it_refuses() -> None:
    with pytest.raises(EstimationError, match="a whole number of estimators from 1, 0 came"):
        BatchEstimator("lab-bench", 0)
    with pytest.raises(EstimationError, match="from 1, True came"):
        BatchEstimator("lab-bench", True)
    with pytest.raises(EstimationError, match="'cpu' or 'cuda', 'gpu' came"):
        BatchEstimator("lab-bench", 1, device="gpu")
    estimator = BatchEstimator("lab-bench", 2)
    good = np.zeros((2, len(estimator.channels)))
    for dt in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(EstimationError, match="an interval above 0 s"):
            estimator.step(dt, good)
    with pytest.raises(EstimationError, match=r"must have shape \(2, 2\)"):
        estimator.step(0.01, good[:1])
    with pytest.raises(EstimationError, match="a sample is wild"):
        estimator.step(0.01, good + 1e12)
    with pytest.raises(EstimationError, match="samples: an array of numbers"):
        estimator.step(0.01, "many")  # type: ignore[arg-type]
    with pytest.raises(EstimationError, match="which: of 2 estimators; index 5 is out of bounds"):
        estimator.reset([5])


def test_without_a_gpu_or_its_library_it_says_so() -> None:
    with pytest.raises(EstimationError, match=r"pip install '\.\[cuda\]'|finds no GPU"):
        BatchEstimator("lab-bench", 1, device="cuda")


MAIN = """
#include <math.h>
#define __device__
#define __global__
struct index {{ long long x; }};
static index blockIdx, blockDim = {{1}}, threadIdx;
{source}
extern "C" void all(long long n, double* state, const double* x, const double* p, double* y) {{
  for (blockIdx.x = 0; blockIdx.x <= n; ++blockIdx.x) {name}_step(n, state, x, p, y);
}}
"""
"""A GPU of one thread after the other."""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
@pytest.mark.parametrize("name", ["lab-bench", "finger-2n"])
def test_its_cuda_is_the_same_filter(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CUDA is C++: without its words a C++ compiler takes it, and the numbers are the same."""

    def on_threads(
        function: torch.ca.Function, p: Floats, n: int
    ) -> tuple[ModuleType, tuple[Floats, ...], torch.Step]:
        source = MAIN.format(source=cuda_source(function), name=function.name())
        (tmp_path / "kernel.cpp").write_text(source)
        library = tmp_path / "kernel.so"
        options = ["-O1", "-ffp-contract=off", "-fno-math-errno", "-shared", "-fPIC", "-w"]
        subprocess.run(
            ["g++", *options, "kernel.cpp", "-o", library.name], cwd=tmp_path, check=True
        )
        advance = ctypes.CDLL(str(library)).all
        advance.argtypes = [ctypes.c_longlong, *4 * [ctypes.c_void_p]]
        sizes = function.numel_in(0), function.numel_in(1), function.numel_out(1)
        arrays = tuple(np.zeros((1, size, n)) for size in sizes)

        def step(kernel_state: Floats, x: Floats, y: Floats) -> None:
            advance(n, *(array.ctypes.data for array in (kernel_state, x, p, y)))

        return np, arrays, step

    monkeypatch.setattr(np, "asnumpy", np.asarray, raising=False)
    monkeypatch.setattr(torch, "_on_gpu", on_threads)
    rig = load_rig(name)
    of = logs(name)
    there = run(BatchEstimator(rig, N, device="cuda"), of)
    here = run(BatchEstimator(rig, N), of)
    assert there[-1].angles == pytest.approx(here[-1].angles, abs=1e-12)
    assert there[-1].stds == pytest.approx(here[-1].stds, abs=1e-12)

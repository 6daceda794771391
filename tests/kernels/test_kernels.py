"""Compiled and interpreted kernels give the same numbers; whatever is broken falls back and says
so.
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from distal import Rig, load_scenario, make_estimator, scenario_rig, simulate
from distal.errors import KernelWarning
from distal.kernels import Kernel, c_source, find_compiler, kernel
from distal.kernels.compiler import Cache, digest
from distal.run import samples_of

pytestmark = pytest.mark.usefixtures("as_users_compile")

needs_compiler = pytest.mark.skipif(
    isinstance(find_compiler(), str), reason="no C compiler on this machine"
)


def small_function(name: str = "small") -> ca.Function:
    kernel_state, x, p = ca.MX.sym("kernel_state", 2), ca.MX.sym("x", 1), ca.MX.sym("p", 1)
    following = ca.vertcat(kernel_state[0] + 0.1 * kernel_state[1], p * kernel_state[1] + x)
    return ca.Function(
        name,
        [kernel_state, x, p],
        [following, ca.sumsqr(following)],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, no memory of what was found or said before."""
    monkeypatch.setenv("DISTAL_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("DISTAL_COMPILE", raising=False)
    find_compiler.cache_clear()
    monkeypatch.setattr(kernel, "_warned", set())
    yield tmp_path / "cache"
    find_compiler.cache_clear()


INPUTS = np.linspace(-1, 1, 40).reshape(-1, 1)
START, P = np.array([0.2, -0.1]), np.array([0.9])


@needs_compiler
def test_scan_is_many_steps_and_compiled_is_interpreted(fresh: Path) -> None:
    compiled, interpreted = Kernel(small_function()), Kernel(small_function(), compiled=False)
    assert (compiled.backend, interpreted.backend) == ("compiled", "interpreted")
    results = [one.scan(START, INPUTS, P) for one in (compiled, interpreted)]
    for got, expected in zip(*results):
        np.testing.assert_array_equal(got, expected)
    kernel_state = START
    for k, x in enumerate(INPUTS):
        (kernel_state,), (y,) = compiled.scan(kernel_state, x, P)
        np.testing.assert_array_equal(kernel_state, results[0][0][k])
        np.testing.assert_array_equal(y, results[0][1][k])


@needs_compiler
@pytest.mark.parametrize("name", ["inextensible", "elastic", "ekf", "ekf-2008"])
def test_estimators_compiled_and_interpreted_agree(name: str) -> None:
    """To 1e-9 over a whole log, relative to each state's range."""
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, 3)
    results = []
    for compiled in (True, False):
        estimator = make_estimator(name, rig, compiled)
        samples = samples_of(log, estimator.channels)
        results.append(
            estimator.scan(estimator.initial(log.time[0], samples[0]), log.time, samples)[0]
        )
    np.testing.assert_allclose(
        results[0], results[1], rtol=1e-9, atol=1e-9 * np.abs(results[1]).max()
    )


@needs_compiler
def test_built_once_and_found_again(fresh: Path) -> None:
    Kernel(small_function())
    built = {path: path.stat().st_mtime_ns for path in fresh.glob("*.so")}
    assert len(built) == 1
    Kernel(small_function())
    assert {path: path.stat().st_mtime_ns for path in fresh.glob("*.so")} == built
    assert not list(fresh.glob("build-*"))


@needs_compiler
@pytest.mark.parametrize("damage", ["empty", "garbage", "truncated", "note"])
def test_a_damaged_library_is_never_loaded(fresh: Path, damage: str) -> None:
    Kernel(small_function())
    (library,) = fresh.glob("*.so")
    (note,) = fresh.glob("*.json")
    content = library.read_bytes()
    if damage == "note":
        note.write_text("{")
    else:
        # a new file: the old one stays mapped by this process
        library.unlink()
        library.write_bytes(
            {"empty": b"", "garbage": b"garbage", "truncated": content[: len(content) // 2]}[damage]
        )
    assert Cache(fresh).find(note.stem) is None
    again = Kernel(small_function())
    assert again.backend == "compiled"
    np.testing.assert_array_equal(
        again.scan(START, INPUTS[0], P)[0],
        Kernel(small_function(), False).scan(START, INPUTS[0], P)[0],
    )


def falls_back(match: str) -> Kernel:
    with pytest.warns(KernelWarning, match=match):
        made = Kernel(small_function())
    assert made.backend == "interpreted"
    np.testing.assert_allclose(made.scan(START, INPUTS[0], P)[0][0], [0.19, -1.09])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Kernel(small_function())  # said once
    return made


def test_no_compiler(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(fresh))
    falls_back("no C compiler was found")


def test_a_compiler_that_fails(
    fresh: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bad = tmp_path / "badcc"
    bad.write_text(
        '#!/bin/sh\n[ "$1" = --version ] && echo "bad 1.0" && exit 0\necho "no space left" '
        ">&2\nexit 1\n"
    )
    bad.chmod(0o755)
    monkeypatch.setenv("CC", str(bad))
    falls_back("the C compiler failed: no space left")


def test_a_compiler_that_does_not_run(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "false")
    falls_back("does not run")


def test_a_compiler_that_is_no_command(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", '"x')
    falls_back("CC is not a command")


def test_an_unwritable_cache(monkeypatch: pytest.MonkeyPatch, fresh: Path, tmp_path: Path) -> None:
    if isinstance(find_compiler(), str):
        pytest.skip("no C compiler on this machine")
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("DISTAL_CACHE", str(blocked / "cache"))
    falls_back("cannot be written")


def test_switched_off_without_a_word(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISTAL_COMPILE", "0")
    assert Kernel(small_function()).reason == "switched off by DISTAL_COMPILE=0"


@needs_compiler
@pytest.mark.slow  # processes of their own
@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.more)])
def test_several_processes_at_once(fresh: Path, count: int) -> None:
    code = (
        "import numpy as np, casadi as ca, warnings; warnings.simplefilter('error')\n"
        "from tests.kernels.test_kernels import *\n"
        "k = Kernel(small_function('shared')); print(k.backend, k.scan(START, INPUTS, "
        "P)[0].tobytes().hex())"
    )
    environment = {**os.environ, "DISTAL_CACHE": str(fresh)}
    running = [
        subprocess.Popen(
            [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True
        )
        for _ in range(count)
    ]
    said = {process.communicate()[0] for process in running}
    assert all(process.returncode == 0 for process in running)
    assert len(said) == 1
    assert said.pop().startswith("compiled ")
    assert not list(fresh.glob("build-*"))


def test_source_depends_on_the_structure_not_on_the_values(paper_rig: Rig) -> None:
    def source(rig: Rig) -> str:
        return c_source(make_estimator("adaptive", rig, compiled=False).kernel.function)

    assert source(paper_rig) == source(paper_rig.with_values({"tendons.0.stiffness": 700.0}))
    assert source(paper_rig) != source(paper_rig.with_values({"tendons.0.damping": 1.0}))


def test_digest_separates_its_parts() -> None:
    assert digest("ab", "c") != digest("a", "bc")


def test_threads_may_share_a_kernel() -> None:
    """Compiled or interpreted: eight threads get what one gets."""
    from concurrent.futures import ThreadPoolExecutor

    kernel_state, x, p = ca.SX.sym("kernel_state", 2), ca.SX.sym("x"), ca.SX.sym("p")
    function = ca.Function(
        "shared",
        [kernel_state, x, p],
        [ca.vertcat(kernel_state[1] + p, ca.sin(kernel_state[0]) + x), kernel_state[0] * x],
    )
    rng = np.random.default_rng(1)
    starts, xs = rng.normal(size=(16, 2)), rng.normal(size=(16, 300, 1))
    for compiled in (True, False):
        kernel = Kernel(function, compiled)
        alone = [kernel.scan(a, b, np.ones(1)) for a, b in zip(starts, xs)]
        with ThreadPoolExecutor(8) as pool:
            together = list(pool.map(kernel.scan, starts, xs, [np.ones(1)] * len(xs)))
        for one, other in zip(alone, together):
            np.testing.assert_array_equal(one[0], other[0])
            np.testing.assert_array_equal(one[1], other[1])


@pytest.mark.parametrize("compiled", [False, True])
def test_a_loop_takes_as_many_parameters_as_there_are(compiled: bool) -> None:
    """Compiled code would read beyond the end of a vector that is too short."""
    with pytest.raises(ValueError, match="reshape"):
        Kernel(small_function(), compiled).loop(np.zeros(0))

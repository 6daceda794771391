"""Compiled and interpreted kernels give the same numbers; whatever is broken falls back and says
so.
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from distal import Rig, make_estimator
from distal.errors import KernelWarning
from distal.kernels import Kernel, c_source, find_compiler, kernel
from distal.kernels.compiler import Cache, digest

pytestmark = pytest.mark.usefixtures("as_users_compile")

needs_compiler = pytest.mark.skipif(
    isinstance(find_compiler(), str), reason="no C compiler on this machine"
)


def small_function(name: str = "small") -> ca.Function:
    kernel_state, x, p = ca.MX.sym("kernel_state", 2), ca.MX.sym("x", 1), ca.MX.sym("p", 1)
    following = ca.vertcat(kernel_state[0] + 0.1 * kernel_state[1], p * kernel_state[1] + x)
    return ca.Function(name, [kernel_state, x, p], [following, ca.sumsqr(following)])


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
    for x, *expected in zip(INPUTS, *results[0]):
        (kernel_state,), (y,) = compiled.scan(kernel_state, x, P)
        np.testing.assert_array_equal([*kernel_state, *y], np.concatenate(expected))


@needs_compiler
def test_built_once_and_found_again(fresh: Path) -> None:
    Kernel(small_function())
    (library,) = fresh.glob("*.so")
    built = library.stat().st_mtime_ns
    Kernel(small_function())
    assert list(fresh.glob("*.so")) == [library]
    assert library.stat().st_mtime_ns == built
    assert not list(fresh.glob("build-*"))


@needs_compiler
@pytest.mark.parametrize("damage", ["empty", "truncated", "note"])
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
        library.write_bytes(content[: len(content) // 2] if damage == "truncated" else b"")
    assert Cache(fresh).find(note.stem) is None
    again, interpreted = Kernel(small_function()), Kernel(small_function(), False)
    assert again.backend == "compiled"
    one, other = (kernel.scan(START, INPUTS[0], P)[0] for kernel in (again, interpreted))
    np.testing.assert_array_equal(one, other)


def falls_back(match: str) -> None:
    with pytest.warns(KernelWarning, match=match):
        made = Kernel(small_function())
    assert made.backend == "interpreted"
    np.testing.assert_allclose(made.scan(START, INPUTS[0], P)[0][0], [0.19, -1.09])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Kernel(small_function())  # said once


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (None, "no C compiler was found"),
        ("{}/badcc", "the C compiler failed: no space left"),
        ("false", "does not run"),
        ('"x', "CC is not a command"),
    ],
)
def test_without_a_compiler_that_works(
    fresh: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: str | None, said: str
) -> None:
    fails = 'echo "no space left" >&2; exit 1'
    bad = tmp_path / "badcc"
    bad.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo "bad 1.0" && exit 0\n{fails}\n')
    bad.chmod(0o755)
    if command is None:
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", str(fresh))
    else:
        monkeypatch.setenv("CC", command.format(tmp_path))
    falls_back(said)


@needs_compiler
def test_an_unwritable_cache(monkeypatch: pytest.MonkeyPatch, fresh: Path, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("DISTAL_CACHE", str(blocked / "cache"))
    falls_back("cannot be written")


def test_switched_off_without_a_word(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISTAL_COMPILE", "0")
    assert Kernel(small_function()).reason == "switched off by DISTAL_COMPILE=0"


@needs_compiler
@pytest.mark.slow  # processes of their own
def test_several_processes_at_once(fresh: Path) -> None:
    code = (
        "import warnings; warnings.simplefilter('error')\n"
        "from tests.kernels.test_kernels import *\n"
        "k = Kernel(small_function('shared')); print(k.backend, k.scan(START, INPUTS, P)[0])"
    )
    environment = {**os.environ, "DISTAL_CACHE": str(fresh)}
    running = [
        subprocess.Popen(
            [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    said = {process.communicate()[0] for process in running}
    assert all(process.returncode == 0 for process in running)
    (same,) = said
    assert same.startswith("compiled ")
    assert not list(fresh.glob("build-*"))


def test_source_depends_on_the_structure_not_on_the_values(paper_rig: Rig) -> None:
    def source(rig: Rig) -> str:
        return c_source(make_estimator("adaptive", rig, compiled=False).kernel.function)

    assert source(paper_rig) == source(paper_rig.with_values({"tendons.0.stiffness": 700.0}))
    assert source(paper_rig) != source(paper_rig.with_values({"tendons.0.damping": 1.0}))


def test_digest_separates_its_parts() -> None:
    assert digest("ab", "c") != digest("a", "bc")


@pytest.mark.parametrize("compiled", [False, True])
def test_threads_may_share_a_kernel(compiled: bool) -> None:
    """Eight threads get what one gets."""
    rng = np.random.default_rng(1)
    runs = list(zip(rng.normal(size=(16, 2)), rng.normal(size=(16, 300, 1)), [P] * 16))
    kernel = Kernel(small_function("shared"), compiled)
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(kernel.scan, *zip(*runs)))
    for run, results in zip(runs, together):
        for one, other in zip(kernel.scan(*run), results):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_loop_takes_as_many_parameters_as_there_are(compiled: bool) -> None:
    """Compiled code would read beyond the end of a vector that is too short."""
    with pytest.raises(ValueError, match="reshape"):
        Kernel(small_function(), compiled).loop(np.zeros(0))

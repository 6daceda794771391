"""Shared libraries of kernels: C from CasADi, built once by the C compiler of this computer."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import cast

import casadi as ca

from distal.codegen import CodeError, Emitter, Lanes, Plain
from distal.kernels.cache import (
    Cache,
    Library,
    Recipe,
    Structure,
    cache_folder,
    check_own,
    cpu,
    digest,
)

# with 512-bit vectors GCC 12 makes wrong code of some filters: a covariance is no longer symmetric
NARROW = ("-mprefer-vector-width=256",) if platform.machine() in ("x86_64", "AMD64") else ()
# no fast-math and no fused multiply-add: the same numbers as the interpreter
FLAGS = (
    "-march=native",
    *NARROW,
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fPIC",
    "-shared",
    "-w",
)

OPTIMISED = "-O3"
"""Level of optimisation of kernels for one run."""

OPTIMISED_LANES = "-O2"
"""Level of optimisation of kernels for lanes. Their vectors are written out, so that a higher one
takes longer and brings nothing.
"""

QUICK = "-O1"
"""Level of optimisation of kernels that are used little, and of all with DISTAL_COMPILE=quick: they
are compiled in a third of the time and run half as fast.
"""

LONG = 500_000
"""Number of characters of C above which `QUICK` is used. Such C is straight lines without
loops, and runs as fast with less effort: a filter with a sheath takes GCC 12 7 s in place of 17,
and 46 µs a sample in place of 44. Source: judgement.
"""

VERY_LONG = 1_500_000
"""Number of characters of C above which `UNOPTIMISED` is used. The equations of a finger with three
sheaths in lanes, 2.8 million characters, take GCC 12 more than five minutes at -O1, and 4 s without
any optimisation. Source: judgement.
"""

UNOPTIMISED = "-O0"
"""Level of optimisation of C with more than `VERY_LONG` characters."""

_SCAN = """
/* {name} over n samples: kernel_state and outputs of every sample are kept, the kernel_state of
 * sample k is the input of k + 1 */
void {name}_scan(long long n, const double* kernel_state, const double* x, const double* p,
                 double* kernel_states, double* y) {{
  long long k;
  for (k = 0; k < n; ++k) {{
    {name}(kernel_state, x + k * {n_x}, p, kernel_states + k * {n_kernel_state}, y + k * {n_y});
    kernel_state = kernel_states + k * {n_kernel_state};
  }}
}}

/* one sample, as CasADi calls what it did not generate */
int {name}_kernel(const double** arg, double** res, long long* iw, double* w, int mem) {{
  {name}(arg[0], arg[1], arg[2], res[0], res[1]);
  return 0;
}}
long long {name}_kernel_n_in(void) {{ return 3; }}
long long {name}_kernel_n_out(void) {{ return 2; }}
static const long long shapes[5][3] = {{
  {{{n_kernel_state}, 1, 1}}, {{{n_x}, 1, 1}}, {{{n_p}, 1, 1}},
  {{{n_kernel_state}, 1, 1}}, {{{n_y}, 1, 1}}
}};
const long long* {name}_kernel_sparsity_in(long long i) {{ return shapes[i]; }}
const long long* {name}_kernel_sparsity_out(long long i) {{ return shapes[3 + i]; }}
"""


SWITCHED_OFF = "switched off by DISTAL_COMPILE=0"
"""Why there is no compiler where the user wants none."""


class CompileError(Exception):
    """A kernel could not be compiled; the message says why in one line."""


class UnwantedError(CompileError):
    """Kernels are not compiled because the user does not want it."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler: its command and the first line of its ``--version``."""

    command: tuple[str, ...]
    version: str


@lru_cache(maxsize=1)
def find_compiler() -> Compiler | str:
    """Return the C compiler ($CC, else cc, gcc, clang), or one line that says why there is none."""
    if os.environ.get("DISTAL_COMPILE", "1") == "0":
        return SWITCHED_OFF
    desired = os.environ.get("CC")
    try:
        commands = [shlex.split(desired)] if desired else [["cc"], ["gcc"], ["clang"]]
    except ValueError as problem:
        return f"CC is not a command ({problem})"
    for command in commands:
        if command and shutil.which(command[0]):
            try:
                version = run_compiler([*command, "--version"])
            except CompileError as problem:
                return f"the C compiler '{command[0]}' does not run: {problem}"
            return Compiler(tuple(command), version.splitlines()[0] if version else command[0])
    tried = ", ".join(command[0] if command else "$CC" for command in commands)
    return f"no C compiler was found (tried {tried}); install gcc or clang, or set CC"


def c_source(function: ca.Function) -> str:
    """Return the C of a kernel (kernel_state, x, p) → (kernel_state, y) with its loop over a whole
    log.

    Raises:
        CompileError: the function has an operation that has no C here.
    """
    return emitted(function, Plain(), _SCAN)


@lru_cache(maxsize=64)
def emitted(function: ca.Function, dialect: Plain | Lanes, loop: str, **sizes: int) -> str:
    """Return the C of a kernel and of a loop over its samples. The `loop` is a template with the
    kernel's name and sizes in braces.

    Raises:
        CompileError: the function has an operation that has no C here.
    """
    emitter = Emitter(dialect)
    try:
        name = emitter.add(function)
    except CodeError as problem:
        raise CompileError(str(problem)) from None
    sizes |= {size: function.numel_in(i) for i, size in enumerate(("n_kernel_state", "n_x", "n_p"))}
    loop = loop.format(name=name, n_y=function.numel_out(1), **sizes)
    return f"#include <math.h>\n{dialect.prelude(emitter.text)}\n{emitter.text}\n{loop}"


def library_of(
    recipe: Recipe, form: str, source: Callable[[ca.Function], str], level: str = OPTIMISED
) -> Library:
    """Return the shared library of a kernel, from the cache or built now.

    If the kernel has a structure, the library is looked for by that, so that a kept one needs no
    function to be made.

    Args:
        form: name of the form of the C, such as its number of lanes.
        source: returns the C of the function.
        level: of the compiler's optimisation.

    Raises:
        CompileError: no compiler, it failed, or the cache cannot be written.
    """
    library = _kept(recipe, form, level)
    if library is None:
        path = compiled_source(recipe.written(source), level)
        library = Library(path, recipe.function.name(), recipe.sizes)
        if recipe.structure is not None:
            cache = _own_cache()
            with _written(cache):
                cache.note(_kept_as(recipe.structure, form, level), library)
    return library


def _kept(recipe: Recipe, form: str, level: str) -> Library | None:
    """Return the library of a recipe that is in the cache."""
    if recipe.structure is None:
        return None
    return _own_cache().find(_kept_as(recipe.structure, form, level))


def compiled_source(source: str, level: str = OPTIMISED) -> Path:
    """Return the shared library of C source, from the cache or built now. Long C is compiled with
    less optimisation than `level`.

    Raises:
        CompileError: no compiler, it failed, or the cache cannot be written.
    """
    cache = _own_cache()
    if os.environ.get("DISTAL_COMPILE") == "quick" or len(source) > LONG:
        level = QUICK
    if len(source) > VERY_LONG:
        level = UNOPTIMISED
    key = _key(source, level)
    library = cache.find(key)
    if library is not None:
        return library.path
    with _written(cache), cache.alone(key):
        library = cache.find(key)  # another process may have built it meanwhile
        if library is None:
            with cache.work_folder() as folder:
                library = cache.keep(key, _build(source, level, Path(folder)))
        return library.path


def _kept_as(structure: Structure, form: str, level: str) -> str:
    return _key(structure.key, form, level, os.environ.get("DISTAL_COMPILE", ""))


def _key(*parts: str) -> str:
    compiler = _needed_compiler()
    command = " ".join(compiler.command)
    return digest(*parts, compiler.version, command, " ".join(FLAGS), cpu(), ca.__version__)


def _own_cache() -> Cache:
    cache = Cache(cache_folder())
    try:
        check_own(cache.folder)
    except OSError as problem:
        raise CompileError(
            f"the cache {cache.folder} is not used: {problem.strerror}; set DISTAL_CACHE"
        ) from None
    return cache


@contextmanager
def _written(cache: Cache) -> Iterator[None]:
    """Raise a CompileError that says in one line why a cache could not be written."""
    try:
        yield
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise CompileError(
            f"the cache {cache.folder} cannot be written ({reason}); set DISTAL_CACHE"
        ) from None


def _needed_compiler() -> Compiler:
    compiler = find_compiler()
    if isinstance(compiler, str):
        raise (UnwantedError if compiler == SWITCHED_OFF else CompileError)(compiler)
    return compiler


def _build(source: str, level: str, folder: Path) -> Path:
    code = folder / "kernel.c"
    library = folder / "kernel.so"
    code.write_text(source, encoding="utf-8")
    run_compiler([*_needed_compiler().command, level, *FLAGS, str(code), "-o", str(library), "-lm"])
    return library


def run_compiler(command: Sequence[str], folder: str | Path = ".") -> str:
    """Run a C compiler in a folder and return what it prints.

    Raises:
        CompileError: it did not run, or it failed.
    """
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=600
        )
    except (OSError, subprocess.SubprocessError) as problem:
        raise CompileError(f"the C compiler did not run ({type(problem).__name__})") from None
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines()
        raise CompileError(
            f"the C compiler failed: {lines[0] if lines else f'exit code {done.returncode}'}"
        )
    return done.stdout


def loaded(library: Library, form: str, arguments: Sequence[type]) -> Callable[..., None]:
    """Return a function of a shared library, such as its ``scan``, with the types of its
    arguments.

    Raises:
        CompileError: the library cannot be loaded.
    """
    try:
        function = getattr(ctypes.CDLL(str(library.path)), f"{library.name}_{form}")
    except (OSError, AttributeError) as problem:
        raise CompileError(
            f"the compiled kernel {library.path} cannot be loaded ({type(problem).__name__})"
        ) from None
    function.restype = None
    function.argtypes = arguments
    return cast("Callable[..., None]", function)


def zig_compiler(target: str) -> list[str] | None:
    """Return the command of ziglang's C compiler for a target, or None where it is not
    installed.
    """
    if importlib.util.find_spec("ziglang") is None:
        return None
    return [sys.executable, "-m", "ziglang", "cc", "-s", "-target", target]

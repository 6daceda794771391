"""Kernels as shared libraries: C from CasADi, built once by the C compiler of this computer, in a
folder that several processes may use at once. There they are found by what they are made from,
the compiler and the CPU; rigs that agree in the structure on which a kernel depends share it,
whatever their numbers are.
"""

from __future__ import annotations

import ctypes
import fcntl
import hashlib
import importlib.util
import json
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from threading import RLock
from typing import cast

import casadi as ca
from pydantic import BaseModel

from distal.codegen import CodeError, Emitter, Lanes, Plain
from distal.kernels.layout import Sizes
from distal.model import Mechanism
from distal.rig import Parameter, Rig
from distal.rig.components import Coupling

INPUTS = frozenset(
    {
        "centre",
        "correlation_time",
        "counts_per_turn",
        "curve",
        "delay",
        "error",
        "error_time",
        "gear",
        "gravity",
        "inertia",
        "lag",
        "lever",
        "limit",
        "linearity",
        "noise",
        "offset",
        "orientation",
        "rate",
        "reference",
        "resolution",
        "std",
        "stops",
        "torque_constant",
        "torque_constant_motor",
        "unmodelled",
    }
)
"""Fields of plain numbers that are inputs of kernels, or do not enter them; any other field is
written into a kernel.
"""

APART = frozenset(
    {
        "name",
        "log",
        "when_lost",
        "stepping",
        "map",
        "left_out",
        "touch",
    }
)
"""Fields of a rig that say nothing of its equations, or whose part in a structure is given
separately.
"""


@dataclass(frozen=True)
class Structure:
    """All that a kernel depends on.

    Args:
        kind: of the kernel, such as ``plant``.
        facts: (name, content) of each thing that the kernel is made for.
    """

    kind: str
    facts: tuple[tuple[str, object], ...]

    @cached_property
    def key(self) -> str:
        """Name of the structure in a cache; it changes with the code of the package."""
        return digest(self.kind, repr(self.facts), source_stamp())


def structure_of(kind: str, mechanism: Mechanism, **decisions: object) -> Structure:
    """Return the structure of a kernel that is made from a rig's equations.

    Args:
        kind: of the kernel, such as ``plant``.
        decisions: anything else that it is made for, such as its sub-steps.
    """
    parameters = mechanism.parameters
    facts = {
        "parts": _parts(mechanism.rig),
        "numbers": parameters.names,
        "absent": parameters.constants,
        **{name.replace("_", " "): value for name, value in decisions.items()},
    }
    return Structure(kind, tuple(facts.items()))


def _parts(rig: Rig) -> tuple[object, ...]:
    return tuple(
        (name, _shape(getattr(rig, name))) for name in type(rig).model_fields if name not in APART
    )


def _shape(part: object) -> object:
    """Return a component of a description without its numbers."""
    if isinstance(part, Parameter):
        return None
    if isinstance(part, Coupling):
        return part.model_dump_json()
    if isinstance(part, BaseModel):
        return tuple(
            (name, _of_field(name, getattr(part, name))) for name in type(part).model_fields
        )
    if isinstance(part, tuple):
        return tuple(map(_shape, part))
    return part


def _of_field(name: str, field: object) -> object:
    if name in INPUTS and not isinstance(field, BaseModel):
        return field is None
    return _shape(field)


@lru_cache(maxsize=1)
def source_stamp() -> str:
    """Return a digest of the package's code: kernels of other code are other kernels."""
    files = sorted(Path(__file__).parents[1].rglob("*.py"))
    return digest(*(path.read_bytes() for path in files))


def sizes_of(function: ca.Function) -> Sizes:
    """Return the lengths of the kernel state, x, p and y of a function of these."""
    # C would write behind the end of an array
    assert function.numel_out(0) == function.numel_in(0), function
    return Sizes._make([*(function.numel_in(i) for i in range(3)), function.numel_out(1)])


_MAKING = RLock()  # CasADi does not count its symbols safely over threads


class Recipe:
    """A CasADi function (kernel_state, x, p) → (kernel_state⁺, y) that is made at its first use.

    Args:
        make: returns the function.
        structure: all that the function depends on; where it is None, compiled kernels are found by
            their C instead.
    """

    def __init__(self, make: Callable[[], ca.Function], structure: Structure | None = None) -> None:
        self._make = make
        self.structure = structure

    @cached_property
    def function(self) -> ca.Function:
        """The CasADi function, made at the first call."""
        with _MAKING:
            return self._make()


def cache_folder() -> Path:
    """Return the folder for compiled kernels: $DISTAL_CACHE, else `distal` in the user's cache
    folder.
    """
    folder = os.environ.get("DISTAL_CACHE")
    if folder:
        return Path(folder).absolute()
    try:
        home = Path.home()
    except RuntimeError:  # neither $HOME nor an entry in the list of users
        return Path(tempfile.gettempdir()).absolute() / f"distal-{os.getuid()}"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "distal"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache").absolute() / "distal"


def check_own(folder: Path) -> None:
    """Refuse a folder into which somebody else may have put libraries, since these are executed.

    Raises:
        PermissionError: it belongs to another user, or others can write to it.
    """
    try:
        status = os.stat(folder)
    except (FileNotFoundError, NotADirectoryError):
        return
    if status.st_uid != os.geteuid():
        raise PermissionError(0, f"it belongs to another user (number {status.st_uid})")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(
            0, f"others can write to it (mode {stat.S_IMODE(status.st_mode):o}); chmod go-w helps"
        )


def cpu() -> str:
    """Return a text that identifies the model and features of this CPU, for which a compiler
    builds.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        features = {line for line in lines if line.startswith(("model name", "flags", "Features"))}
        return platform.machine() + "".join(sorted(features))
    except OSError:
        return platform.machine() + platform.processor()


def digest(*parts: str | bytes) -> str:
    """Return a hexadecimal digest (SHA-256) of the parts, which tells where one ends and the next
    begins.
    """
    sha = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        sha.update(len(content).to_bytes(8, "little") + content)
    return sha.hexdigest()


@dataclass(frozen=True)
class Library:
    """A shared library with a kernel.

    Args:
        name: of the kernel's function; empty for one that is found by its C.
        sizes: lengths of its kernel state, x, p and y; zero for one that is found by its C.
    """

    path: Path
    name: str
    sizes: Sizes


class Cache:
    """A folder of shared libraries. Each library has a note with its digest, so that a damaged one
    is never loaded.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, key: str) -> Library | None:
        """Return the library kept under `key`, or None if there is none or it is damaged."""
        try:
            note = json.loads((self.folder / f"{key}.json").read_text(encoding="utf-8"))
            path = self.folder / str(note["library"])
            library = Library(path, str(note["name"]), Sizes._make(map(int, note["sizes"])))
            return library if digest(path.read_bytes()) == note["digest"] else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    @contextmanager
    def alone(self, key: str) -> Iterator[Path]:
        """Let one process at a time build what is kept under `key`; the others wait. What is built
        in the temporary folder that is given can be moved into the cache in one operation.

        Raises:
            CompileError: the cache cannot be written; the message says why in one line.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            lock = self.folder / f"{key}.lock"
            with (
                lock.open("w") as file,
                tempfile.TemporaryDirectory(dir=self.folder, prefix="build-") as folder,
            ):
                with suppress(OSError):  # a file system without locks: each process builds its own
                    fcntl.flock(file, fcntl.LOCK_EX)
                yield Path(folder)
                # processes that wait for this file, or come later, find the library
                lock.unlink(missing_ok=True)
        except OSError as problem:
            reason = problem.strerror or str(problem)
            raise CompileError(
                f"the cache {self.folder} cannot be written ({reason}); set DISTAL_CACHE"
            ) from None

    def keep(self, key: str, built: Path) -> Library:
        """Move a library that was `built` in the folder of `alone` into the cache, and return it
        from there.

        Library and note are each renamed, the note last, so that a reader sees both or none.

        Raises:
            OSError: the cache cannot be written.
        """
        fingerprint = digest(built.read_bytes())
        path = self.folder / f"{key}-{fingerprint[:16]}.so"
        library = Library(path, "", Sizes(0, 0, 0, 0))
        os.replace(built, path)
        self.note(key, library, built.parent)
        return library

    def note(self, key: str, library: Library, folder: Path) -> None:
        """Write the note that a library of the cache is kept under `key`, by way of the folder of
        `alone`.

        Raises:
            OSError: the cache cannot be written.
        """
        note = {
            "library": library.path.name,
            "digest": digest(library.path.read_bytes()),
            "name": library.name,
            "sizes": library.sizes,
        }
        written = folder / "note.json"
        written.write_text(json.dumps(note), encoding="utf-8")
        os.replace(written, self.folder / f"{key}.json")


# with 512-bit vectors GCC 12 makes wrong code of some filters: a covariance is no longer symmetric
NARROW = ("-mprefer-vector-width=256",) if platform.machine() in ("x86_64", "AMD64") else ()
# no fast-math and no fused multiply-add: the same numbers as the interpreter
FLAGS = (
    "-march=native",
    *NARROW,
    "-ffp-contract=off",
    "-fno-math-errno",
    # from -O2 on GCC 12 for AVX-512 copies {2, 2, 2, 2}, {0, 0, 0, 0} as eight twos
    "-fno-tree-loop-distribute-patterns",
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
def emitted(function: ca.Function, dialect: Plain | Lanes, loop: str) -> str:
    """Return the C of a kernel and of a loop over its samples. The `loop` is a template with the
    kernel's name and sizes, and the fields of the dialect, in braces.

    Raises:
        CompileError: the function has an operation that has no C here.
    """
    emitter = Emitter(dialect)
    try:
        name = emitter.add(function)
    except CodeError as problem:
        raise CompileError(str(problem)) from None
    sizes = {f"n_{part}": size for part, size in sizes_of(function)._asdict().items()}
    loop = loop.format(name=name, **sizes, **vars(dialect))
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
    if recipe.structure is None:
        return _built(recipe, source, level)
    cache = _own_cache()
    key = _key(recipe.structure.key, form, level, os.environ.get("DISTAL_COMPILE", ""))
    library = cache.find(key)
    if library is None:
        library = _built(recipe, source, level)
        with cache.alone(key) as folder:
            cache.note(key, library, folder)
    return library


def _built(recipe: Recipe, source: Callable[[ca.Function], str], level: str) -> Library:
    function = recipe.function
    with _MAKING:
        text = source(function)
    return Library(compiled_source(text, level), function.name(), sizes_of(function))


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
    with cache.alone(key) as folder:
        library = cache.find(key)  # another process may have built it meanwhile
        if library is None:
            code = folder / "kernel.c"
            built = folder / "kernel.so"
            code.write_text(source, encoding="utf-8")
            command = [*needed_compiler().command, level, *FLAGS, str(code), "-o", str(built)]
            run_compiler([*command, "-lm"])
            library = cache.keep(key, built)
        return library.path


def _key(*parts: str) -> str:
    compiler = needed_compiler()
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


def needed_compiler() -> Compiler:
    """Return the C compiler.

    Raises:
        CompileError: there is none, or it is `SWITCHED_OFF`.
    """
    compiler = find_compiler()
    if isinstance(compiler, str):
        raise CompileError(compiler)
    return compiler


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

"""C from CasADi's functions, written for few bytes: views instead of copies, loops instead of unrolled matrices.

CasADi's own generator copies each slice of a vector and keeps a slot per intermediate; on a microcontroller that is
most of the memory, and it has no vector lanes. docs/results/performance.md has the figures.

From text to function, each module knows only those above it:

* ``operations``: CasADi's operations, sorted by how C writes them;
* ``dialects``: how a number and an operation are written: double, float, vector lanes;
* ``memory``: where numbers lie, and the C that reaches them: arguments, constants, scratch shared by lifetimes;
* ``dataflow``: which instruction reads and makes what, and until when each value is needed;
* ``placement``: where each result goes: a view, over an input that nothing needs any more, or new scratch;
* ``workspace``: these four together, for one function of matrices;
* ``elements``, ``slices``, ``products``, ``calls``: writers, each a function from an instruction to lines of C;
* ``matrices``: the table operation → writer, and the walk over the instructions of a function of matrices (MX);
* ``scalars``: a function of scalars (SX), as straight lines;
* ``emitter``: functions, each written once, after those that it calls.

An operation of matrices that has no C yet is one more writer, and one more line in the table of ``matrices``.
"""

from distal.codegen.dialects import Dialect, Lanes, Plain
from distal.codegen.emitter import Emitter
from distal.codegen.operations import CodeError

__all__ = ["CodeError", "Dialect", "Emitter", "Lanes", "Plain"]

"""C from CasADi's functions, written for few bytes: views instead of copies, loops instead of
unrolled matrices.

CasADi's own generator copies each slice of a vector and keeps a slot per intermediate; on a
microcontroller that is most of the memory, and it has no vector lanes. docs/results/performance.md
has the figures.

In: CasADi functions and a dialect (double, float, vector lanes); out: lines of C. Each module knows
only those before it: ``operations_and_number_types``; ``instructions``, each a function from an
instruction to lines of C, with their memory; ``emitter`` for all functions.

An operation of matrices that has no C yet is one more writer, and one more line in the table of
``instructions``.
"""

from distal.codegen.emitter import Emitter, unused
from distal.codegen.operations_and_number_types import CodeError, Dialect, Lanes, Plain

__all__ = ["CodeError", "Dialect", "Emitter", "Lanes", "Plain", "unused"]

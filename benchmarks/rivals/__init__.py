"""A rival of `adaptive`, for benchmarks only: another way to treat the same model, at a multiple of
its cost.

`iterated` linearises each row of the update again. It is made from the parts of
`distal.estimators.adaptive`, so that what differs is the filter and not the model.
"""

from benchmarks.rivals.iterated import IteratedFilter

__all__ = ["IteratedFilter"]

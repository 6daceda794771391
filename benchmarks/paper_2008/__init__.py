"""The 2008 paper: its filters, which are there as the estimators `ekf` and `ekf-2008` where this
package is imported, its test series and its statements.

`python -m benchmarks.paper_2008`, which `make demo` calls, writes figures, results and a page.
"""

from benchmarks.paper_2008.full_state import FullStateFilter, Noise, paper_noise, rig_noise

__all__ = ["FullStateFilter", "Noise", "paper_noise", "rig_noise"]

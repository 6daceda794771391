"""What a fit found: values with standard errors, where each comes from, and the rig with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.fitting.affine import AffineFit, affine_table
from distal.fitting.contact import ContactFit
from distal.fitting.discrepancy import DiscrepancyFit
from distal.fitting.fitted import Fitted, assignments
from distal.fitting.fitted_file import MARK, fitted_text, plain
from distal.fitting.leaving_out import Compared, verdict
from distal.logs import shown, write_whole
from distal.rig import Rig

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """The outcome of `fit`.

    Args:
        rig: the description with the fitted values.
        start: the description as it came.
        fitted: every free number.
        logs: names of the logs.
        duration: of all of them [s].
        samples: of all of them.
        homing: for how long a reference was used, None for wherever it is [s].
        correlations: of the parameters' errors, (n, n), in the order of `fitted`.
        combinations: plain lines on what the logs cannot tell apart.
        channels: names of the channels that were compared.
        nis_before: mean ν²/S per channel at the start; 1 is expected.
        nis_after: the same at the end.
        cost_before: −ln p at the start, less constants.
        cost_after: at the end.
        iterations: of the search.
        converged: whether the search ended by itself.
        interrupted: whether the user stopped it.
        evaluations: runs of the filter over all logs.
        curves: path → value of what was learned of the position sensors' systematic errors.
        affine: the obvious estimator's map from the same logs, where some have a truth; the rig holds it.
        discrepancy: what the model leaves of the angle, from the same logs; the rig holds it.
        compared: each log left out once, with how the fitted rig, the rig as it came and `affine` do on it.
        doubts: plain sentences on what speaks against the fit.
        left: share of the priors' stds that the rig's numbers keep where there are doubts: the widest with which the angle
            is not clearly worse on these logs; 0 is `hold`.
        contact: the torque from outside as learned from logs that have it; the rig holds it.
    """

    rig: Rig
    start: Rig
    fitted: tuple[Fitted, ...]
    logs: tuple[str, ...]
    duration: float
    samples: int
    homing: float | None
    correlations: Floats
    combinations: tuple[str, ...]
    channels: tuple[str, ...]
    nis_before: tuple[float, ...]
    nis_after: tuple[float, ...]
    cost_before: float
    cost_after: float
    iterations: int
    converged: bool
    interrupted: bool
    evaluations: int
    curves: Mapping[str, object] = field(default_factory=dict)
    affine: AffineFit | None = None
    discrepancy: DiscrepancyFit | None = None
    compared: tuple[Compared, ...] = ()
    doubts: tuple[str, ...] = ()
    left: float = 1.0
    contact: ContactFit | None = None

    @property
    def verdict(self) -> str:
        """Which estimator did better on logs left out, in a sentence; empty where none was."""
        return verdict(self.compared)

    def __getitem__(self, name: str) -> Fitted:
        """Return a fitted number by its name or one of its paths.

        Raises:
            KeyError: there is none.
        """
        for part in self.fitted:
            if name == part.name or name in part.paths:
                return part
        raise KeyError(name)

    def save(self, path: str | Path, text: str | None = None) -> None:
        """Write the fitted rig file; what stood there survives a failure.

        Args:
            path: where.
            text: TOML that the values are put into, so that its comments stay; default the description written anew.

        Raises:
            OutputError: it cannot be written.
        """
        write_whole(path, fitted_text(self.rig, self.start, self.assignments(), self._account(), text))

    def assignments(self) -> dict[str, Any]:
        """Return path → value (with its std, where it had one) of what changed, as for `Rig.with_values`."""
        learned = {"affine": affine_table(self.affine.affine)} if self.affine is not None else {}
        if self.discrepancy is not None:
            learned["discrepancy"] = plain(self.discrepancy.discrepancy.model_dump())
        if self.contact is not None:
            learned["contact"] = plain(self.contact.contact.model_dump())
        return {**assignments(self.fitted, self.start, self.left), **self.curves, **learned}

    def _account(self) -> str:
        """Return the comment at the head of a fitted file: what it was fitted to, and where each value came from."""
        names = ", ".join(shown(name.rsplit("/", 1)[-1]) for name in self.logs)
        use = "" if self.homing is None else f", as used with a reference for the first {self.homing:g} s"
        lines = [
            f"{MARK} to {len(self.logs)} log{'s' if len(self.logs) > 1 else ''} ({self.duration:.0f} s){use}:",
            f"# {names}",
        ]
        if self.interrupted:
            lines.append("# The search was interrupted: these are the best values so far.")
        rows = [("number", "value", "± standard error", "started at", "from")]
        for part in self.fitted:
            error = f"{part.error:.2g}" if np.isfinite(part.error) else "–"
            prior = "" if np.isnan(part.prior_std) else f" ± {part.prior_std:.3g}"
            rows.append(
                (part.name, f"{part.value:.5g} {part.si}".strip(), error, f"{part.start:.5g}{prior}", part.origin)
            )
        widths = [max(len(row[i]) for row in rows) for i in range(4)]
        lines += ["#   " + "  ".join([*(row[i].ljust(widths[i]) for i in range(4)), row[4]]) for row in rows]
        if self.curves:
            lines.append(
                "# Learned too: the systematic curves of the position sensors (curve), and what linearity is left."
            )
        lines += [f"# These logs tell {line}." for line in self.combinations]
        if self.affine is not None:
            lines += [f"# {line}" for line in (self.affine.text, *self.affine.notes)]
        if self.discrepancy is not None:
            lines += [f"# {line}" for line in self.discrepancy.notes]
        if self.contact is not None:
            lines.append(f"# {self.contact.text}")
        lines += [f"# {line}" for line in (*self.doubts, self.verdict) if line]
        return "\n".join(lines) + "\n\n"

"""The result of an estimator on a log."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.confidence import BAND, COVERED_TEXT
from distal.errors import EstimationError, did_you_mean
from distal.estimators import StateKind, states_of
from distal.logs import header
from distal.results.plots import PlotOptions, SummaryRow, html_table, plot_estimates
from distal.rig import std_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


UNKNOWN = 180.0
"""Half-width of a band from which on an angle is not known [deg]. Source: definition (a turn)."""

ANGLE_UNITS = {"rad": 1.0, "deg": float(np.deg2rad(1.0))}
"""Unit in which angles may be written → its size [rad]. Source: definition (unit conversion)."""


@dataclass(frozen=True, repr=False)
class Estimate:
    """The estimated states over a log, with their standard deviations, and the innovations.

    Args:
        estimator: name of the estimator.
        rig: title of the rig.
        time: stamps [s], (k,).
        state_names: names of the n states; the joint angles [rad] come first.
        means: estimated states in SI, (k, n).
        variances: variances of the states' errors, (k, n).
        measured: names of the m channels with an innovation.
        innovations: innovations ν, (k, m); NaN where a reading is missing or is not compared (a
            force whose slider is at a stop).
        innovation_variances: variances S of the innovations, (k, m).
        truths: true joint angles [rad], (k, n_joints), NaN where an angle is not known; None where
            none is.
        covariances: covariances of the states' errors, (k, n, n); None from a batch, where they
            would fill the memory.
        joint_names: names of the joints.
        notes: remarks of the estimator on its estimate, one sentence each, such as how much was
            outside a learned range.
        prior_means: prior means of the states that are constants of the rig or its sensors, (n,),
            NaN for states that vary; None where the estimator has no such constants.
        prior_stds: prior standard deviations of the same states, (n,).
        stamps: dates of the log since 1970 [ns], (k,), if it has dates; they link results to other
            recordings.
        torque_truths: true external torques on the joints [N m], (k, n_joints); None where none is
            known.
        unseen: a sentence on joint motions that the sensors cannot observe, which is also in
            `notes`; None where there is no such motion, as far as is known.
        state_kinds: kind of each state, (n,).
        state_parts: name of the joint, drive, tendon or sensor to which each state belongs, or the
            path of a parameter of the rig, (n,).
        state_units: SI unit of each state, (n,), empty where it is not known.
        is_taught: whether logs taught what forces are normal: not the innovations tell then what
            disagrees, since the rig lacks physics, but the forces by the positions.
        ends: the estimate at the first and the last sample with all states, where only some are
            here.
    """

    estimator: str
    rig: str
    time: Floats
    state_names: tuple[str, ...]
    means: Floats
    variances: Floats
    measured: tuple[str, ...]
    innovations: Floats
    innovation_variances: Floats
    _: KW_ONLY
    truths: Floats | None = None
    covariances: Floats | None = None
    joint_names: tuple[str, ...] = ("joint",)
    notes: tuple[str, ...] = ()
    prior_means: Floats | None = None
    prior_stds: Floats | None = None
    stamps: NDArray[np.int64] | None = None
    torque_truths: Floats | None = None
    unseen: str | None = None
    state_kinds: tuple[StateKind, ...]
    state_parts: tuple[str, ...]
    state_units: tuple[str, ...]
    is_taught: bool = False
    ends: Estimate | None = None

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        """Return a short description of the estimate."""
        lines = [self.in_words(joint) for joint in range(len(self.joint_names))]
        return (
            f"{len(self)} samples of '{self.rig}', {self.time[0]:g} to {self.time[-1]:g} s; "
            f"{'; '.join(lines)}"
        )

    def _repr_html_(self) -> str:
        """Return the short description and the `table` as HTML, which notebooks show."""
        return f"<p>{escape(repr(self))}</p>{self.table()}"

    def table(self) -> str:
        """Return the `summary` as a table in HTML."""
        rows = [
            (
                row["joint"],
                f"{row['least [deg]']:.2f}° to {row['greatest [deg]']:.2f}°",
                f"±{row['median band [deg]']:.2f}°",
                "" if row["RMS error [deg]"] is None else f"{row['RMS error [deg]']:.2f}°",
                "" if row["inside band"] is None else f"{100 * row['inside band']:.0f} %",
            )
            for row in self.summary()
        ]
        band = f"{COVERED_TEXT} band, median"
        return html_table(["joint", "angle", band, "RMS error", "inside"], rows, range(1, 5))

    def in_words(self, joint: int = 0) -> str:
        """Return one line on a joint: the range of its angle, its band, and its error where the
        truth is known.

        Args:
            joint: index of the joint.
        """
        row = self.summary()[joint]
        which = "angle" if len(self.joint_names) == 1 else f"angle of {row['joint']}"
        half = row["median band [deg]"]
        if half > UNKNOWN:
            return (
                f"{self.estimator}: {which} is not known, {COVERED_TEXT} band above ±{UNKNOWN:g}°"
            )
        text = (
            f"{self.estimator}: {which} from {row['least [deg]']:.2f}° to "
            f"{row['greatest [deg]']:.2f}°, {COVERED_TEXT} band ±{half:.2f}° (median)"
        )
        if row["RMS error [deg]"] is None or row["inside band"] is None:
            return text
        return (
            f"{text}, RMS error {row['RMS error [deg]']:.3g}°, {100 * row['inside band']:.0f} "
            "% inside the band"
        )

    def summary(self) -> list[SummaryRow]:
        """Return a row for each joint: range, band and errors [deg], and the coverage of the band.

        The band is the median half-width of the 95 % band; ``inside band`` is the share
        of samples inside it. Errors and coverage are None where the truth is not known.
        """
        rows = []
        for joint, name in enumerate(self.joint_names):
            angles = self.angles[:, joint]
            stds = self.angle_stds[:, joint]
            truth = np.full(len(self), np.nan) if self.truths is None else self.truths[:, joint]
            has_truth = np.isfinite(truth)
            errors = np.abs(angles - truth)[has_truth]
            row: SummaryRow = {
                "joint": name,
                "least [deg]": float(np.rad2deg(angles.min())),
                "greatest [deg]": float(np.rad2deg(angles.max())),
                "median band [deg]": float(np.rad2deg(BAND * np.median(stds))),
                "RMS error [deg]": None,
                "largest error [deg]": None,
                "inside band": None,
            }
            if has_truth.any():
                row["RMS error [deg]"] = float(np.rad2deg(np.sqrt(np.mean(errors**2))))
                row["largest error [deg]"] = float(np.rad2deg(errors.max()))
                row["inside band"] = float(np.mean(errors <= BAND * stds[has_truth]))
            rows.append(row)
        return rows

    @property
    def with_all_states(self) -> Estimate:
        """The estimate, or its `ends`, which have all states."""
        return self if self.ends is None else self.ends

    @property
    def angles(self) -> Floats:
        """Estimated joint angles [rad], (k, n_joints)."""
        return self.means[:, : len(self.joint_names)]

    @property
    def angle_stds(self) -> Floats:
        """Standard deviations of the errors of the joint angles [rad], (k, n_joints)."""
        return np.sqrt(self.variances[:, : len(self.joint_names)])

    @property
    def theta(self) -> Floats:
        """Estimated angle of the only joint [rad], (k,).

        Raises:
            EstimationError: there are several joints.
        """
        return self._only(self.angles, "theta", "angles")

    @property
    def theta_std(self) -> Floats:
        """Standard deviation of the error of the only joint's angle [rad], (k,).

        Raises:
            EstimationError: there are several joints.
        """
        return self._only(self.angle_stds, "theta_std", "angle_stds")

    @property
    def truth(self) -> Floats | None:
        """True angle of the only joint [rad], (k,), or None where it is not known.

        Raises:
            EstimationError: there are several joints.
        """
        return None if self.truths is None else self._only(self.truths, "truth", "truths")

    def _only(self, columns: Floats, name: str, several: str) -> Floats:
        if len(self.joint_names) != 1:
            raise EstimationError(
                f"'{name}' is for rigs of one joint, this one has {', '.join(self.joint_names)}; "
                f"use '{several}', (samples, joints)"
            )
        return columns[:, 0]

    def state(self, name: str) -> Floats:
        """Return the mean of a state over time in SI, (k,).

        Args:
            name: a name in `state_names`, or the path of a parameter of the rig that the estimator
                estimates.

        Raises:
            EstimationError: there is no such state.
        """
        states = zip(self.state_names, self.state_kinds, self.state_parts)
        for i, (state, kind, part) in enumerate(states):
            if name == state or (kind is StateKind.PARAMETER and name == part):
                return self.means[:, i]
        raise EstimationError(f"no state is called '{name}'{did_you_mean(name, self.state_names)}")

    @property
    def stds(self) -> Floats:
        """Standard deviations of the errors of all states, in SI, (k, n)."""
        return np.sqrt(self.variances)

    @property
    def external_torques(self) -> Floats:
        """Estimated external torques on the joints [N m], (k, n_joints).

        Raises:
            EstimationError: the rig excludes such a torque for a joint (``external_torque.std =
                0``).
        """
        return self.means[:, self._torque_states()]

    @property
    def external_torque_stds(self) -> Floats:
        """Standard deviations of the errors of the external torques [N m], (k, n_joints).

        Raises:
            EstimationError: the rig excludes such a torque for a joint.
        """
        return np.sqrt(self.variances[:, self._torque_states()])

    @property
    def external_torque(self) -> Floats:
        """Estimated external torque on the only joint [N m], (k,), such as that of a hand or a
        contact.

        Raises:
            EstimationError: there are several joints, or the rig excludes such a torque.
        """
        return self._only(self.external_torques, "external_torque", "external_torques")

    @property
    def external_torque_std(self) -> Floats:
        """Standard deviation of the error of the only joint's external torque [N m], (k,).

        Raises:
            EstimationError: there are several joints, or the rig excludes such a torque.
        """
        return self._only(self.external_torque_stds, "external_torque_std", "external_torque_stds")

    def _torque_states(self) -> list[int]:
        columns = states_of(
            StateKind.EXTERNAL_TORQUE, self.joint_names, self.state_kinds, self.state_parts
        )
        for joint in self.joint_names:
            if joint not in columns:
                raise EstimationError(
                    f"{self.estimator} has no torque on '{joint}'; adaptive has, if the rig says "
                    f"how large it may be: --set 'joints.{joint}.external_torque.std=\"0.05 N m\"'"
                )
        return list(columns.values())

    def errors(self) -> Floats:
        """Return estimated minus true angle [rad], NaN where the truth is missing.

        The shape is (k,) for one joint, else (k, n_joints).

        Raises:
            EstimationError: no truth is known.
        """
        if self.truths is None:
            raise EstimationError("the log has no truth; read the log with truth=…")
        errors = self.angles - self.truths
        return errors[:, 0] if len(self.joint_names) == 1 else errors

    def rms_error(self) -> float:
        """Return the root mean square of the `errors` over all samples and joints [rad]."""
        return float(np.sqrt(np.nanmean(self.errors() ** 2)))

    def max_error(self) -> float:
        """Return the largest magnitude of the `errors` [rad]."""
        return float(np.nanmax(np.abs(self.errors())))

    def inside_band(self) -> float:
        """Return the coverage of the band: the share of samples, over all joints, whose truth
        is inside.
        """
        errors = self.errors()
        inside = np.abs(errors) <= BAND * self.angle_stds.reshape(errors.shape)
        return float(np.mean(inside[np.isfinite(errors)]))

    def columns(self, unit: str = "rad", *, every: bool = False) -> dict[str, NDArray[np.generic]]:
        """Return header → column: ``t [s]``, the angles, their standard deviations ``…_std``, and
        the external torques.

        Where the log has dates, ``stamp [ns]`` comes after the time.

        Args:
            unit: unit of the angles, "rad" or "deg".
            every: whether all states and their standard deviations are there.

        Raises:
            EstimationError: the unit is neither.
        """
        if unit not in ANGLE_UNITS:
            raise EstimationError(
                f"unit '{unit}': angles are written in {' or '.join(ANGLE_UNITS)}"
            )
        columns: dict[str, NDArray[np.generic]] = {header("t", "s"): self.time}
        if self.stamps is not None:
            columns[header("stamp", "ns")] = self.stamps
        for i, (name, kind, si) in enumerate(
            zip(self.state_names, self.state_kinds, self.state_units)
        ):
            factor = 1.0
            written = si
            if si in ("rad", "rad/s"):
                factor = 1.0 / ANGLE_UNITS[unit]
                written = si.replace("rad", unit)
            if every or kind in (StateKind.ANGLE, StateKind.EXTERNAL_TORQUE):
                columns[header(name, written)] = factor * self.means[:, i]
            if every or kind is StateKind.ANGLE:
                columns[header(std_name(name), written)] = factor * np.sqrt(self.variances[:, i])
        return columns

    def plot(self, path: str | Path | None = None, **options: Unpack[PlotOptions]) -> Figure:
        """Draw truth, estimate and 95 % band over time, and save the figure as PNG, SVG or PDF
        where a path is given.

        The `options` are those of `distal.plot_estimates`.
        """
        return plot_estimates([self], path=path, **options)

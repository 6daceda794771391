"""What a plot needs of an estimate."""

from __future__ import annotations

from typing import Protocol

from distal.arrays import Floats


class Curves(Protocol):
    """An object with the curves of an estimate that a plot draws, such as `distal.Estimate`."""

    @property
    def estimator(self) -> str:
        """Name of the estimator."""

    @property
    def rig(self) -> str:
        """Title of the rig."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""

    @property
    def time(self) -> Floats:
        """Stamps [s], (k,)."""

    @property
    def angles(self) -> Floats:
        """Angles of the joints [rad], (k, n_joints)."""

    @property
    def angle_stds(self) -> Floats:
        """Standard deviations of the errors of the joint angles [rad], (k, n_joints)."""

    @property
    def level(self) -> float:
        """Share of the errors that the band is to hold."""

    @property
    def truths(self) -> Floats | None:
        """True joint angles [rad], (k, n_joints), or None where none is known."""

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the m channels with an innovation."""

    @property
    def innovations(self) -> Floats:
        """Innovations ν, measured minus predicted, in SI, (k, m)."""

    @property
    def innovation_variances(self) -> Floats:
        """Variances S of the innovations, (k, m)."""

"""What a plot draws of an estimate."""

from __future__ import annotations

from typing import Protocol

from distal.arrays import Floats


class Curves(Protocol):
    """What is drawn of an estimate: see `distal.Estimate`."""

    @property
    def estimator(self) -> str:
        """Its name."""

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
        """Standard deviations of their errors [rad], (k, n_joints)."""

    @property
    def truths(self) -> Floats | None:
        """True angles [rad], (k, n_joints), or None."""

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the channels with an innovation."""

    @property
    def innovations(self) -> Floats:
        """Measured minus predicted, (k, m)."""

    @property
    def innovation_variances(self) -> Floats:
        """Their variances, (k, m)."""

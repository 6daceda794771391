"""The masses of the links of joints in series, by the torques that their motion needs.

    Σ r T = Σ_k m_k ∂τ/∂m_k + b dθ/dt + f sign(dθ/dt) + c₀ + c₁ sin θ + c₂ cos θ

for each joint is solved by least squares over all logs, with the masses' guess as their prior. τ is
the torque on the joint that a motion of the links needs (`distal.model`); the terms c stand for
weight and for load cells that were tared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.from_logs.derivatives import smoothed, window_of
from distal.from_logs.found_parts import FoundDrive, FoundJoint, pulls_of, torque_of
from distal.from_logs.motion_data import MotionData
from distal.model import Mechanism
from distal.rig import Rig

MASS = 10.0
"""Mass of a link and its standard deviation [g]. Source: judgement (plastic fingers)."""

LIGHTEST = 1.0
"""Least mass of a link [g]. Source: judgement."""

INDEPENDENT = 20.0
"""So many samples, whose errors are alike, count as one. Source: judgement."""

TURNS_OVER = 0.05
"""Speed over which the direction of a joint's friction turns [rad/s]. Source: judgement."""

OWN = 5
"""Number of columns of each joint beside the masses: b, f, c₀, c₁, c₂. Source: definition."""


def link_masses(
    rig: Rig,
    carrying: Sequence[int],
    joints: Sequence[FoundJoint],
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
) -> list[tuple[float, float]]:
    """Return the mass of each link with its standard deviation [g].

    Args:
        rig: the rig with guessed masses.
        carrying: indices of the joints that have a link.
        joints: in the order of their columns.
        drives: all of them.
        logs: all of them.
    """
    count = len(carrying)
    torques = _torques_of_masses(rig, [joints[j].name for j in carrying])
    parts = [part for log in logs for part in _equations(log, carrying, joints, drives, torques)]
    if not parts:
        return [(MASS, MASS)] * count
    matrix = np.vstack([columns for columns, _ in parts])
    target = np.concatenate([values for _, values in parts])
    size = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
    scaled = matrix / size
    left = target - scaled @ np.linalg.lstsq(scaled, target, rcond=None)[0]
    noise = INDEPENDENT * max(float(np.mean(left**2)), 1e-300)
    prior = np.zeros(matrix.shape[1])
    prior[:count] = 1e-3 * MASS * size[:count]
    precision = np.zeros(matrix.shape[1])
    precision[:count] = prior[:count] ** -2
    covariance = np.linalg.pinv(scaled.T @ scaled / noise + np.diag(precision))
    solution = covariance @ (scaled.T @ target / noise + precision * prior)
    masses = 1e3 * solution[:count] / size[:count]
    stds = 1e3 * np.sqrt(np.diag(covariance)[:count]) / size[:count]
    return [(max(float(mass), LIGHTEST), float(std)) for mass, std in zip(masses, stds)]


def _torques_of_masses(rig: Rig, carrying: Sequence[str]) -> ca.Function:
    """Return the function (q, v, a) → ∂τ/∂m, (n_joints, n_links), of the links of some joints."""
    mechanism = Mechanism(rig)
    assert mechanism.chain is not None
    parameters = mechanism.parameters
    q, v, a = (ca.SX.sym(name, mechanism.n_joints) for name in "qva")
    links = [f"joints.{rig.joint_names.index(name)}.link.mass" for name in carrying]
    masses = ca.vertcat(*(parameters[link] for link in links))
    per_mass = ca.jacobian(mechanism.chain.torques(q, v, a), masses)
    known = ca.substitute(per_mass, parameters.symbols, ca.DM(parameters.values))
    return ca.Function("torques", [q, v, a], [ca.densify(known)])


def _equations(
    log: MotionData,
    carrying: Sequence[int],
    joints: Sequence[FoundJoint],
    drives: Sequence[FoundDrive],
    torques: ca.Function,
) -> Iterator[tuple[Floats, Floats]]:
    """Yield columns and torques of each joint that carries a link, on one log."""
    known = np.isfinite(log.angles).all(axis=1)
    step = float(np.median(np.diff(log.time)))
    angles = log.angles[known]
    if len(angles) < 2:
        return
    window = max(window_of(angles[:, j], step, joints[j].noise) for j in carrying)
    if len(angles) < 2 * window:
        return
    q, v, a = (smoothed(angles, window, step, order) for order in range(3))
    per_mass = np.array([np.array(torques(*row)) for row in zip(q, v, a)])
    for place, j in enumerate(carrying):
        columns = np.zeros((len(q), len(carrying) * (1 + OWN)))
        columns[:, : len(carrying)] = per_mass[:, j]
        first = len(carrying) + OWN * place
        columns[:, first : first + OWN] = np.column_stack(
            [
                v[:, j],
                np.tanh(v[:, j] / TURNS_OVER),
                np.ones(len(q)),
                np.sin(q[:, j]),
                np.cos(q[:, j]),
            ]
        )
        yield columns, smoothed(torque_of(pulls_of(j, drives), log)[known], window, step)

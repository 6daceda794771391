"""Learned maps whose numbers are drawn, for tests of what runs them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.regression import Shape, features_along
from distal.rig import LearnedMap, MapArrays, Rig
from distal.rig.learned import features_of

Floats = NDArray[np.float64]

RADIAL = 5


def drawn_map(
    joints: tuple[str, ...] = ("jaw",),
    channels: tuple[str, ...] = ("motor_angle", "motor_torque"),
    beside_filter: bool = True,
    seed: int = 8,
    size: float = 0.01,
) -> LearnedMap:
    """Return a map of which the first channel is a position."""
    rng = np.random.default_rng(seed)
    count = len(channels) + (len(joints) if beside_filter else 0)
    moving = [0, *range(len(channels), count)]
    inputs = count + len(moving)
    n = features_of(count) + RADIAL
    points = rng.normal(size=(RADIAL, inputs))
    squares = ((points[:, None] - points[None]) ** 2).sum(-1)
    roots = 0.1 * size * rng.normal(size=(len(joints), n, n))
    return LearnedMap(
        joints=joints,
        channels=channels,
        positions=channels[:1],
        beside_filter=beside_filter,
        logs=7,
        low=(-1.0,) * count,
        high=(1.0,) * count,
        arrays=MapArrays(
            centre=0.1 * rng.normal(size=count),
            scale=rng.uniform(0.1, 0.5, size=count),
            rate=rng.uniform(1.0, 3.0, size=count),
            play=np.array([0.7]),
            lengths=rng.uniform(1.0, 3.0, size=inputs),
            points=points,
            root=np.linalg.inv(np.linalg.cholesky(np.exp(-squares / 2) + 1e-6 * np.eye(RADIAL))),
            mean=size * rng.normal(size=(len(joints), n)),
            covariance=roots @ np.swapaxes(roots, 1, 2),
            radial=np.full(len(joints), size**2),
            noise=np.full(len(joints), size**2),
            filter=rng.uniform(0.2, 0.8, size=len(joints)),
            error_time=np.full(len(joints), 0.5),
            correlation=np.full((len(joints), len(joints)), 0.3) + 0.7 * np.eye(len(joints)),
        ),
    )


def constant_map(joint: str, channels: tuple[str, ...], offset: float, std: float) -> LearnedMap:
    """Return the map of a joint that adds an `offset` of a standard deviation, whatever is read."""
    drawn = drawn_map((joint,), channels)
    mean, covariance, radial = (
        0.0 * drawn.arrays[name] for name in ("mean", "covariance", "radial")
    )
    mean[0, 0] = offset
    zero = {"mean": mean, "covariance": covariance, "radial": radial}
    return with_arrays(drawn, **zero, noise=np.array([std**2]), filter=np.ones(1))


def resting(learned: LearnedMap) -> LearnedMap:
    """Return a map of logs in which nothing moves: a filter judges positions as without it."""
    return with_arrays(learned, rate=0.0 * learned.arrays["rate"])


def with_arrays(learned: LearnedMap, **changed: Floats) -> LearnedMap:
    """Return a map with other numbers."""
    arrays = MapArrays(**{**learned.arrays.by_name, **changed})
    return learned.model_copy(update={"arrays": arrays})


def with_drawn(rig: Rig, seed: int = 8, size: float = 0.01) -> Rig:
    """Return a rig of one independent part with maps of both kinds, on its positions and forces."""
    position = tuple(s.name for s in rig.sensors_of("position"))
    others = tuple(s.name for kind in ("tension", "force") for s in rig.sensors_of(kind))
    joints = tuple(rig.joint_names)
    channels = (*position, *others)
    return rig.with_map(
        readings=[drawn_map(joints, channels, False, seed, size)],
        filter=[resting(drawn_map(joints, channels, True, seed, size))],
    )


def frame_of(learned: LearnedMap) -> Floats:
    """Return what the features of a map are computed with, as one vector."""
    arrays = learned.arrays
    names = Shape.of(learned).frame.names
    return np.concatenate([arrays[name].ravel(order="F") for name in names])


def along(learned: LearnedMap, time: Floats, readings: Floats) -> dict[str, Floats]:
    """Return what a map sees over a log."""
    return features_along(Shape.of(learned), frame_of(learned), time, readings)


def predict(learned: LearnedMap, outputs: dict[str, Floats], joint: int) -> tuple[Floats, Floats]:
    """Return value and variance of a map for a joint over a log, (k,) each, without what missing
    readings and intervals of slips add, from `outputs`, the parts of `features_along`.
    """
    arrays = learned.arrays
    phi = outputs["features"]
    spread = np.sum((phi @ arrays["covariance"][joint]) * phi, axis=1)
    far = arrays["radial"][joint] * outputs["far"][:, 0]
    return phi @ arrays["mean"][joint], spread + arrays["noise"][joint] + far

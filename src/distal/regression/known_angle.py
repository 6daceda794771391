"""A map that is conditioned on an angle that is known now, while its kernel runs."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.regression.features import Shape, features_function
from distal.regression.map_function import map_layout
from distal.rig import LearnedMap


@dataclass(frozen=True)
class PlacedMap:
    """A map in a kernel.

    Args:
        learned: the map.
        memory: index in the kernel state at which its memory begins.
        parameters: index in the kernel's parameters at which its own begin.
    """

    learned: LearnedMap
    memory: int
    parameters: int

    def condition(
        self, kernel_state: Floats, parameters: Floats, joint: int, target: float, variance: float
    ) -> float:
        """Condition the weights on a value that is known at the last sample, in place, and return
        by how many of its standard deviations it was off.

        With φ of that sample, the innovation ν = target − φᵀ m and S = φᵀ C φ + σ² + s_r² far +
        variance: m⁺ = m + C φ ν/S and C⁺ = C − C φ φᵀ C/S. Where ν² is larger than S, the zero has
        moved: the constant's variance and S are larger by ν² − S, see `Weights.given`.

        Args:
            kernel_state: after the last sample.
            parameters: of the kernel; changed.
            joint: index of the joint among those of the map.
            target: what the map should have given.
            variance: of the error of that value.
        """
        shape = Shape.of(self.learned)
        layout = map_layout(shape, len(self.learned.joints))
        memory = kernel_state[self.memory : self.memory + shape.memory.size]
        of_map = parameters[self.parameters : self.parameters + layout.size]
        outputs, _ = features_function(shape)(
            memory,
            0.0,
            memory[shape.memory["last"]],
            np.ones(shape.channels),
            of_map[layout["frame"]],
        )
        out = np.array(ca.DM(outputs)).ravel()
        phi = out[shape.outputs["features"]]
        n = len(phi)
        weights = of_map[layout["mean"]][joint * n : (joint + 1) * n]
        covariance = of_map[layout[f"covariance_{joint}"]].reshape(n, n)
        cross = covariance @ phi
        spread = float(phi @ cross) + variance + of_map[layout["noise"]][joint]
        spread += of_map[layout["radial"]][joint] * out[shape.outputs["far"]][0]
        innovation = target - float(phi @ weights)
        off = abs(innovation) / float(np.sqrt(spread))
        zero = max(0.0, innovation**2 - spread)
        covariance[0, 0] += zero
        cross[0] += zero
        spread += zero
        weights += cross * innovation / spread
        covariance -= np.outer(cross, cross) / spread
        return off

"""The plant: the full model as a kernel, and its equilibrium at the start."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from distal.errors import ScenarioError
from distal.kernels import Kernel
from distal.model import Mechanism, interval_step
from distal.simulation.inputs import BodyInputs

Floats = NDArray[np.float64]


def plant_function(mechanism: Mechanism, count: int) -> ca.Function:
    """Return (carry, x, p) → (carry⁺, y) of the plant over one interval of `count` sub-steps.

    carry = (q, v); x = (effort, added inertia, servo, dt); y = (q, v, tensions, pull on each drive), the pull being
    what a load cell or torque sensor between the source and the drive reads: U = W − (W/g) ẍ for a hung weight.

    Args:
        mechanism: the plant's equations.
        count: sub-steps per interval.
    """
    n = mechanism.n_bodies
    step = interval_step(mechanism, count, with_servo=True)
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    tensions = ca.Function("tensions", [q, v, mechanism.parameters.symbols], [mechanism.tensions(q, v)])
    carry = ca.MX.sym("carry", 2 * n)
    x, p = ca.MX.sym("x", 5 * n + 1), ca.MX.sym("p", len(mechanism.parameters))
    before, dt = carry[n:], x[5 * n]
    effort, added, servo = x[:n], x[n : 2 * n], ca.reshape(x[2 * n : 5 * n], n, 3)
    q_next, v_next = step(carry[:n], before, effort, added, servo, dt, p)
    acceleration = (v_next - before) / dt
    pull = effort - added * acceleration + servo[:, 0] * (servo[:, 1] - q_next) - servo[:, 2] * v_next
    y = ca.vertcat(q_next, v_next, tensions(q_next, v_next, p), pull[mechanism.n_joints :])
    return ca.Function("plant", [carry, x, p], [ca.vertcat(q_next, v_next), y], ["carry", "x", "p"], ["next", "y"])


def run_plant(mechanism: Mechanism, inputs: BodyInputs, start: Floats, dt: float, count: int) -> dict[str, Floats]:
    """Return the plant's motion at the start and after every interval.

    Args:
        mechanism: the plant's equations.
        inputs: what acts in each interval, n of them.
        start: coordinates at rest, (n_bodies,).
        dt: length of an interval [s].
        count: sub-steps per interval.

    Raises:
        ScenarioError: the motion left all bounds.
    """
    n, m = mechanism.n_bodies, mechanism.n_tendons
    kernel = Kernel(plant_function(mechanism, count))
    servo = inputs.servo.transpose(0, 2, 1).reshape(len(inputs.effort), 3 * n)
    xs = np.hstack([inputs.effort, inputs.added_inertia, servo, np.full((len(inputs.effort), 1), dt)])
    p = mechanism.parameters.values
    # the first row is the start itself: a tiny interval gives tensions and pulls there
    still = np.concatenate([start, np.zeros(n)])
    first = xs[:1].copy()
    first[0, -1] = 1e-12
    _, y_start = kernel.scan(still, first, p)
    _, ys = kernel.scan(still, xs, p)
    y_start[:, :n], y_start[:, n : 2 * n] = start, 0.0
    y_start[:, 2 * n + m :] = (inputs.effort + inputs.servo[:, :, 0] * (inputs.servo[:, :, 1] - start))[
        :1, mechanism.n_joints :
    ]
    y = np.vstack([y_start, ys])
    if not np.all(np.isfinite(y)) or np.abs(y[:, :n]).max() > 1e3:
        raise ScenarioError(
            "the simulated motion left all bounds: a force without a stop or tendon that holds it, "
            "or a step that is too long (see stepping.largest_step)"
        )
    return {"q": y[:, :n], "v": y[:, n : 2 * n], "tensions": y[:, 2 * n : 2 * n + m], "pulls": y[:, 2 * n + m :]}


def equilibrium(mechanism: Mechanism, angles: Floats, inputs: BodyInputs) -> Floats:
    """Return the coordinates at which every drive is in equilibrium with the joints held at `angles`.

    A slack tendon counts as if it could push, so that a drive without a pull stands where its tendon is just straight.

    Args:
        mechanism: the plant's equations.
        angles: joint angles [rad], (n_joints,).
        inputs: what acts; the first interval counts.

    Raises:
        ScenarioError: a drive has no equilibrium.
    """
    from scipy.optimize import brentq

    p = mechanism.parameters
    q = ca.SX.sym("q", mechanism.n_bodies)
    elastic = ca.vertcat(
        *(
            p[f"tendons.{i}.stiffness"] * mechanism.elongations(q)[i] + p[f"tendons.{i}.pretension"]
            for i in range(mechanism.n_tendons)
        )
    )
    force = ca.Function("force", [q, p.symbols], [-ca.mtimes(mechanism.length_jacobian(q).T, elastic)])
    place = np.concatenate([angles, np.zeros(mechanism.n_drives)])
    servo = inputs.servo[0]

    for i in range(mechanism.n_joints, mechanism.n_bodies):
        bounds = mechanism.rig.drives[i - mechanism.n_joints].stops

        def net(position: float, body: int = i) -> float:
            place[body] = position
            spring = servo[body, 0] * (servo[body, 1] - position)
            return float(force(place, p.values)[body]) + float(inputs.effort[0, body]) + float(spring)

        reach = 1e-3
        while not (net(-reach) > 0.0 > net(reach)):
            reach *= 2.0
            if reach > 1e3:
                raise ScenarioError(f"drives.{mechanism.bodies[i].name}: no equilibrium at the start; check its pull")
        place[i] = float(brentq(net, -reach, reach, xtol=1e-12))
        if bounds is not None:
            place[i] = float(np.clip(place[i], *bounds))
    return place

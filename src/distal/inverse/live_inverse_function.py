"""One sample of the inverse in a control loop, at the parameters and angles that the filter
believes, with feedback of the estimated angle.

A reference r follows the desired angle w by  dr/dt = dw/dt + clip(ε/h, ± √(2 a |ε|)),  with ε = w −
r one sample h before, and is limited to the speed and the acceleration a of the joint. The angle
that is commanded is  r + T dr/dt + (T²/2) d²r/dt² + c − m,  with the lag and delay T of the drives
(`Servo`), the third term no larger than the second, and the correction m by a learned map. The
correction c follows from the estimated angle θ̂ and the error e = r − θ̂ by  dc/dt = k e  outside
of a dead band, which ends stick-slip (Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30,
1994). Drives that follow forces get the torque  K_p e + K_i ∫ e dt + K_d (dr/dt − dθ̂/dt)  in
addition.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.estimators.adaptive import StateVector
from distal.expressions import Scalar, Vector, VectorNode
from distal.inverse.expected_readings import read_function
from distal.inverse.setpoint_function import CommandModel
from distal.inverse.setpoint_inputs import DERIVED
from distal.kernels import Layout, Structure, structure_of

SMOOTHED = 0.005
"""Time constant with which the reference's speed and acceleration are smoothed [s]. Source:
judgement.
"""

LEAVES = 2.0
"""Error at which a joint that rests within its dead band is corrected again, in dead bands [1].
Source: judgement.
"""

SHORTEST = 1e-9
"""Shortest step in time by which differences are divided [s]. Source: rounding (division by a step
of zero).
"""

SPEEDS_UP = 0.1
"""Time in which a joint comes to its largest speed [s]. Source: judgement."""

COMES_BACK = 0.1
"""Time in which a drive that follows speeds makes up for a wrong position [s]. Source: judgement.
"""

BEYOND = 1e-9
"""Distance beyond a drive's range from which on the drive counts as at its end [m, rad]. Source:
rounding (positions that are equal).
"""

MOST = float(np.deg2rad(20.0))
"""Largest correction c of an angle by feedback [rad]. Source: judgement."""


GUIDED = ("wished", "reference", "rate", "speed", "acceleration", "correction", "effort", "rests")
"""State of the reference and of the feedback that is kept for each free joint."""

GAINS = ("fastest", "lowest", "compensates", "follow", "deadband", "kp", "ki", "kd", "torque_limit")
"""Gains of the reference and of the feedback: one for each free joint, except for those in
`OF_ALL`.
"""

OF_ALL = ("lowest", "compensates")
"""Gains that all joints have in common: the least tension, and whether commands hold against
external torques (1) or not (0).
"""

TOUCHED = 0.5
"""Share of a touch from which on feedback does not integrate [1]. Source: judgement."""


@dataclass(frozen=True)
class LiveLayouts:
    """Layouts of the kernel state, the sample, the gains and the output of `live_function`."""

    kernel_state: Layout
    x: Layout
    gains: Layout
    y: Layout


def layouts(model: CommandModel, states: StateVector) -> LiveLayouts:
    """Return the layouts of the live inverse of a rig."""
    nf = model.nf
    nd = model.nd
    return LiveLayouts(
        kernel_state=Layout(
            **dict.fromkeys((*GUIDED, "last"), nf),
            mapped=nf,
            at_end=1,
            started=1,
            command=model.kernel_state.size,
        ),
        x=Layout(dt=1, desired=nf, state=len(states), mapped=nf, read=nd, trusted=1, touched=1),
        gains=Layout(**dict.fromkeys(GAINS, nf) | dict.fromkeys(OF_ALL, 1)),
        y=Layout(angles=nf, positions=nd, speeds=nd, forces=nd, tensions=model.nt, at_end=nd),
    )


def live_function(model: CommandModel, states: StateVector) -> ca.Function:
    """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of one sample, whose output y are
    the drives' commands.

    The parameters p are the gains, the filter's parameters and the inputs of `command_inputs`. In
    the sample x, `state` is the filter's mean with the angles as they are reported, `mapped` the
    correction of these by maps, and `read` what the drives' position sensors read. The positions in
    y are as these sensors would read them.
    """
    layout = layouts(model, states)
    kernel_state = ca.MX.sym("kernel_state", layout.kernel_state.size)
    x = ca.MX.sym("x", layout.x.size)
    n_gains = layout.gains.size
    n_filter = len(states.context.mechanism.parameters)
    p = ca.MX.sym("p", n_gains + n_filter + len(model.derived))
    was = layout.kernel_state.parts(kernel_state)
    came = layout.x.parts(x)
    gains = layout.gains.parts(p)
    own = p[n_gains : n_gains + n_filter]
    command, mapped, at_end = (was.pop(name) for name in ("command", "mapped", "at_end"))
    # maps that are not trusted, far from where they were learned, are not followed, nor torques
    # from outside
    mapped = ca.if_else(came["trusted"] > 0, came["mapped"], mapped)
    parameters, torques = _believed(model, states)(came["state"], own, p[n_gains + n_filter :])
    inputs = {**{f"{name}_before": part for name, part in was.items()}, **gains}
    # nothing winds up against a stop, nor against the end of a drive's range
    inputs |= {
        "dt": came["dt"],
        "desired": model.within_stops(came["desired"], parameters),
        "trusted": came["trusted"],
    }
    inputs["free"] = came["touched"] < TOUCHED
    inputs["winds"] = came["trusted"] * (1 - at_end) * inputs["free"]
    guided = _guide(model)(
        angles=came["state"][model.free], **{k: v for k, v in inputs.items() if k not in OF_ALL}
    )
    later = model.number(parameters, ["lead"])
    bend = _limited(later**2 / 2 * guided["acceleration"], ca.fabs(later * guided["speed"]))
    ahead = guided["reference"] + later * guided["speed"] + bend + guided["correction"] - mapped
    row = model.x.joined(
        dt=came["dt"],
        angles=model.within_stops(ahead, parameters),
        speeds=guided["speed"] + guided["correcting"],
        accelerations=guided["acceleration"],
        torques=came["trusted"] * gains["compensates"] * torques
        + ca.mtimes(ca.DM(np.linalg.pinv(np.array(model.mechanism.spread)).T), guided["pushed"]),
        lowest=gains["lowest"],
    )
    command, y = model.function()(command, row, parameters)
    commanded = model.y.parts(y)
    commanded["at_end"] = (
        ca.fabs(model.kernel_state.part(command, "positions") - commanded["positions"]) > BEYOND
    )
    commanded["positions"] = read_function(model, states)(
        commanded["positions"], came["state"], own
    )
    commanded["forces"] = _within_limits(model, commanded["forces"], parameters)
    commanded["speeds"] += (commanded["positions"] - came["read"]) / COMES_BACK
    soft = model.of_drives(parameters, "soft")
    dead = model.of_drives(parameters, "dead")
    turned = model.kernel_state.part(command, "drives_turned")
    commanded["positions"] += soft * commanded["forces"] + dead * turned
    after = {name: guided[name] for name in GUIDED}
    following = layout.kernel_state.joined(
        **after,
        last=came["state"][model.free],
        mapped=mapped,
        at_end=ca.dot(commanded["at_end"], commanded["at_end"]) > 0,
        started=ca.MX(1),
        command=command,
    )
    y = layout.y.joined(**{name: commanded[name] for name in layout.y.names})
    return ca.Function(
        "live_command",
        [kernel_state, x, p],
        [following, y],
        ["kernel_state", "x", "p"],
        ["next", "y"],
    )


def live_structure(model: CommandModel, states: StateVector) -> Structure:
    """Return the structure on which the compiled kernel of `live_function` depends."""
    of_filter = states.context.mechanism.parameters.names, states.structure
    return structure_of("live", model.mechanism, filter=of_filter)


def _guide(model: CommandModel) -> ca.Function:
    """Return the function of one sample of the reference and its motion, the correction, and the
    torque of feedback.
    """
    sizes = dict.fromkeys(("desired", "angles"), model.nf) | {
        "dt": 1,
        "trusted": 1,
        "winds": 1,
        "free": 1,
        "started_before": 1,
    }
    sizes |= dict.fromkeys((f"{name}_before" for name in (*GUIDED, "last")), model.nf)
    sizes |= dict.fromkeys((name for name in GAINS if name not in OF_ALL), model.nf)
    v = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    dt = v["dt"]
    angles = v["angles"]
    trusted = v["trusted"]
    started = v["started_before"]
    safe = ca.fmax(dt, SHORTEST)
    share = dt / (dt + SMOOTHED)
    # it begins where the joint is, if that is known
    first = ca.if_else(trusted > 0, angles, v["desired"])
    before, wished = (
        ca.if_else(started > 0, v[name], first) for name in ("reference_before", "wished_before")
    )
    most = v["fastest"] / SPEEDS_UP
    behind = wished - before
    catching_up = _limited(behind / safe, ca.sqrt(2 * most * ca.fabs(behind)))
    rate = _limited(
        _limited((v["desired"] - wished) / safe, v["fastest"]) + catching_up, v["fastest"]
    )
    rate = v["rate_before"] + _limited(rate - v["rate_before"], most * dt)
    reference = before + rate * dt
    speed = v["speed_before"] + share * (rate - v["speed_before"])
    change = (speed - v["speed_before"]) / safe - v["acceleration_before"]
    error = reference - angles
    rests = ca.fabs(error) < v["deadband"] * ca.if_else(v["rests_before"] > 0, LEAVES, 1)
    counted = trusted * ca.if_else(rests, 0, error - _limited(error, v["deadband"]))
    correction = _limited(v["correction_before"] + v["winds"] * v["follow"] * counted * dt, MOST)
    turning = started * (angles - v["last_before"]) / safe
    asked = v["kp"] * counted + v["ki"] * v["effort_before"] + v["kd"] * trusted * (speed - turning)
    pushed = _limited(asked, v["torque_limit"])
    found = {
        "wished": v["desired"],
        "reference": reference,
        "rate": rate,
        "speed": speed,
        "acceleration": v["acceleration_before"] + share * change,
        "correction": correction,
        # what is cut, or presses on what is touched, does not wind up
        "effort": v["effort_before"] + v["free"] * ca.if_else(pushed == asked, counted * dt, 0),
        "rests": rests,
        "correcting": (correction - v["correction_before"]) / safe,
        "pushed": -pushed,
    }
    return ca.Function("guide", list(v.values()), list(found.values()), list(v), list(found))


def _limited(value: Vector, most: Scalar) -> Vector:
    return ca.fmin(ca.fmax(value, -most), most)


def _within_limits(model: CommandModel, forces: VectorNode, parameters: VectorNode) -> VectorNode:
    """Return the forces of drives, limited to what each can do; a slider cannot push."""
    high = model.of_drives(parameters, "limit")
    pushes = ca.DM([drive.kind != "slider" for drive in model.rig.drives])
    # no product with a limit that may be infinite
    low = ca.if_else(pushes, -high, 0)
    return ca.fmin(ca.fmax(forces, low), high)


def _believed(model: CommandModel, states: StateVector) -> ca.Function:
    """Return the function (state, p, derived) → parameters of the inverse as the filter believes
    them, and external torques, (n_joints,).
    """
    state = ca.SX.sym("state", len(states))
    known = states.context.mechanism.parameters
    learned = states.parameters(state)
    desired = model.mechanism.parameters
    inside = model.kernel_state["inside"].stop - model.kernel_state["inside"].start
    derived = ca.SX.sym("derived", len(model.derived))
    others = iter(ca.vertsplit(derived))
    at = {name: i for i, name in enumerate(known.names)}
    names = desired.names[: len(desired) - inside]
    parameters = [next(others) if name.startswith(DERIVED) else learned[at[name]] for name in names]
    outputs = [ca.densify(ca.vertcat(*parameters)), ca.densify(states.torques(state))]
    return ca.Function("believed", [state, known.symbols, derived], outputs)

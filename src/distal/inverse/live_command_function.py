"""One sample of the inverse in a control loop, at the parameters and angles that the filter
believes, with feedback of the estimated angle.

A reference r follows the desired angle w by  dr/dt = dw/dt + clip(ε/h, ± √(2 a |ε|)),  with ε = w −
r one sample h before, and is limited to the speed and the acceleration a of the joint. The angle
that is commanded is  r + T dr/dt + (T²/2) d²r/dt² + c − m,  with the lag and delay T of the drives
(`Servo`), the third term no larger than the second, and the correction m by a learned map. The
correction c follows from the estimated angle θ̂ and the error e = r − θ̂ by  dc/dt = k e  outside
of a dead band. Drives that follow forces get the torque of `feedback_torques` in addition.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators import SHORTEST, TOUCHED
from distal.estimators.adaptive import StateVector, state_vector
from distal.inverse.command_inputs import DERIVED
from distal.inverse.feedforward import KERNEL, CommandModel
from distal.inverse.pid import REMEMBERED, Feedback, feedback_torques, limited
from distal.kernels import Layout, Structure, structure_of
from distal.rig import Rig

SMOOTHED = 0.005
"""Time constant with which the reference's speed and acceleration are smoothed [s]. Source:
judgement.
"""

RESPONDS = 0.1
"""Time in which a joint comes to its largest speed, and in which a drive that follows speeds makes
up for a wrong position [s]. Source: judgement.
"""

AT_END = 1e-9
"""Distance beyond a drive's range from which on the drive counts as at its end [m, rad]. Source:
rounding (positions that are equal).
"""

GUIDED = ("wished", "reference", "rate", "speed", "acceleration", "correction", *REMEMBERED)
"""State of the reference and of the feedback that is kept for each free joint."""

OF_ALL = ("lowest", "compensates")
"""Gains that all joints have in common: the least tension, and whether commands hold against
external torques (1) or not (0).
"""

OF_EACH = ("fastest", *vars(Feedback()))
"""Gains of each free joint: its largest speed [rad/s], and those of its `Feedback`."""


class LiveModel:
    """The inverse of a rig in a control loop as a kernel: its function, and the layouts of its
    kernel state, of a sample, of its gains and of its output.

    Args:
        rig: the description.
        states: of the filter that tells the angles.
        folded: whether what the rig states is a constant of the function.
    """

    def __init__(self, rig: Rig, states: StateVector, folded: bool = False) -> None:
        self.model = model = CommandModel(rig, folded)
        self.states = states
        nf = model.nf
        nd = model.nd
        self.kernel_state = Layout(
            **dict.fromkeys((*GUIDED, "last", "mapped"), nf),
            at_end=1,
            started=1,
            command=model.kernel_state.size,
        )
        self.x = Layout(
            dt=1, desired=nf, state=len(states), mapped=nf, read=nd, trusted=1, touched=1
        )
        self.gains = Layout(**dict.fromkeys(OF_ALL, 1), **dict.fromkeys(OF_EACH, nf))
        self.y = Layout(angles=nf, positions=nd, speeds=nd, forces=nd, tensions=model.nt, at_end=nd)

    @property
    def structure(self) -> Structure:
        """The structure on which the compiled kernel depends."""
        of_filter = self.states.context.mechanism.parameters.names, self.states.structure
        return structure_of("live", self.model.mechanism, filter=of_filter)

    def function(self) -> ca.Function:
        """Return the kernel (kernel_state, x, p) → (kernel_state⁺, y) of one sample, whose output y
        are the drives' commands.

        The parameters p are the gains, the filter's parameters and the inputs of `command_inputs`.
        In the sample x, `state` is the filter's mean with the angles as they are reported, `mapped`
        the correction of these by maps, and `read` what the drives' position sensors read. The
        positions in y are as these sensors would read them.
        """
        model = self.model
        states = self.states
        kernel_state = ca.MX.sym("kernel_state", self.kernel_state.size)
        x = ca.MX.sym("x", self.x.size)
        sizes = self.gains.size, len(states.context.mechanism.parameters), len(model.derived)
        p = ca.MX.sym("p", sum(sizes))
        of_gains, own, derived = ca.vertsplit(p, np.cumsum([0, *sizes]).tolist())
        was = self.kernel_state.parts(kernel_state)
        came = self.x.parts(x)
        gains = self.gains.parts(of_gains)
        command, mapped, at_end = (was.pop(name) for name in ("command", "mapped", "at_end"))
        # maps that are not trusted, far from where they were learned, are not followed, nor torques
        # from outside
        mapped = ca.if_else(came["trusted"] > 0, came["mapped"], mapped)
        parameters, torques = self._believed()(came["state"], own, derived)
        inputs = {f"{name}_before": part for name, part in was.items()}
        inputs |= {name: gains[name] for name in OF_EACH}
        free = came["touched"] <= TOUCHED
        # nothing winds up against a stop, nor against the end of a drive's range
        guided = guide_function(model.nf)(
            angles=came["state"][model.free],
            desired=model.within_stops(came["desired"], parameters),
            dt=came["dt"],
            trusted=came["trusted"],
            free=free,
            winds=came["trusted"] * (1 - at_end) * free,
            **inputs,
        )
        later = model.number(parameters, ["lead"])
        bend = limited(later**2 / 2 * guided["acceleration"], ca.fabs(later * guided["speed"]))
        ahead = guided["reference"] + later * guided["speed"] + bend + guided["correction"] - mapped
        row = model.x.joined(
            dt=came["dt"],
            angles=model.within_stops(ahead, parameters),
            speeds=guided["speed"] + guided["correcting"],
            accelerations=guided["acceleration"],
            torques=came["trusted"] * gains["compensates"] * torques
            + ca.mtimes(
                ca.DM(np.linalg.pinv(np.array(model.mechanism.spread)).T), guided["pushed"]
            ),
            lowest=gains["lowest"],
        )
        command, y = model.function()(command, row, parameters)
        sent = model.y.parts(y)
        at_end = ca.fabs(model.kernel_state.part(command, "positions") - sent["positions"]) > AT_END
        forces = self._within_limits(sent["forces"], parameters)
        positions = read_function(states)(sent["positions"], came["state"], own)
        # servos give way: by their stiffness, and by their dead band in the direction of motion
        ahead = model.of_drives(parameters, "soft") * forces
        ahead += model.of_drives(parameters, "dead") * model.kernel_state.part(
            command, "drives_turned"
        )
        following = self.kernel_state.joined(
            **{name: guided[name] for name in GUIDED},
            last=came["state"][model.free],
            mapped=mapped,
            at_end=ca.dot(at_end, at_end) > 0,
            started=ca.MX(1),
            command=command,
        )
        y = self.y.joined(
            angles=sent["angles"],
            positions=positions + ahead,
            speeds=sent["speeds"] + (positions - came["read"]) / RESPONDS,
            forces=forces,
            tensions=sent["tensions"],
            at_end=at_end,
        )
        return ca.Function("live_command", [kernel_state, x, p], [following, y], *KERNEL)

    def _within_limits(self, forces: ca.MX, parameters: ca.MX) -> ca.MX:
        """Return the forces of drives, limited to what each can do; a slider cannot push."""
        high = self.model.of_drives(parameters, "limit")
        pushes = ca.DM([drive.kind != "slider" for drive in self.model.rig.drives])
        # no product with a limit that may be infinite
        return ca.fmin(ca.fmax(forces, ca.if_else(pushes, -high, 0)), high)

    def _believed(self) -> ca.Function:
        """Return the function (state, p, derived) → parameters of the inverse as the filter
        believes them, and external torques, (n_joints,).
        """
        model = self.model
        states = self.states
        state = ca.SX.sym("state", len(states))
        known = states.context.mechanism.parameters
        derived = ca.SX.sym("derived", len(model.derived))
        learned = dict(zip(known.names, ca.vertsplit(states.parameters(state))))
        others = iter(ca.vertsplit(derived))
        names = model.mechanism.parameters.names[: model.n_parameters]
        parameters = [next(others) if name.startswith(DERIVED) else learned[name] for name in names]
        outputs = [ca.densify(ca.vertcat(*parameters)), ca.densify(states.torques(state))]
        return ca.Function("believed", [state, known.symbols, derived], outputs)


def guide_function(nf: int) -> ca.Function:
    """Return the function of one sample of the reference and its motion, the correction, and the
    torque of feedback, for `nf` joints.
    """
    of_all = dict.fromkeys(("dt", "trusted", "winds", "free", "started_before"), 1)
    before = (f"{name}_before" for name in (*GUIDED, "last"))
    sizes = dict.fromkeys(("desired", "angles", *before, *OF_EACH), nf) | of_all
    v = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    dt = v["dt"]
    angles = v["angles"]
    trusted = v["trusted"]
    started = v["started_before"]
    safe = ca.fmax(dt, SHORTEST)
    share = dt / (dt + SMOOTHED)
    # it begins where the joint is, if that is known
    first = ca.if_else(trusted > 0, angles, v["desired"])
    was, wished = (
        ca.if_else(started > 0, v[name], first) for name in ("reference_before", "wished_before")
    )
    most = v["fastest"] / RESPONDS
    behind = wished - was
    catching_up = limited(behind / safe, ca.sqrt(2 * most * ca.fabs(behind)))
    rate = limited(
        limited((v["desired"] - wished) / safe, v["fastest"]) + catching_up, v["fastest"]
    )
    rate = v["rate_before"] + limited(rate - v["rate_before"], most * dt)
    reference = was + rate * dt
    speed = v["speed_before"] + share * (rate - v["speed_before"])
    change = (speed - v["speed_before"]) / safe - v["acceleration_before"]
    turning = started * (angles - v["last_before"]) / safe
    made = feedback_torques(
        v,
        before={name: v[f"{name}_before"] for name in REMEMBERED},
        error=reference - angles,
        lag=speed - turning,
        dt=dt,
        trusted=trusted,
        # what presses on what is touched does not wind up
        free=v["free"],
    )
    correction = limited(
        v["correction_before"] + v["winds"] * v["follow"] * made.errors * dt,
        v["correction_limit"],
    )
    found = {
        "wished": v["desired"],
        "reference": reference,
        "rate": rate,
        "speed": speed,
        "acceleration": v["acceleration_before"] + share * change,
        "correction": correction,
        **made.after,
        "correcting": (correction - v["correction_before"]) / safe,
        "pushed": -made.torques,
    }
    return ca.Function("guide", list(v.values()), list(found.values()), list(v), list(found))


def read_function(states: StateVector) -> ca.Function:
    """Return the function (positions, state, p) → readings of the drives' position sensors,
    (n_drives,) [m, rad], with the offsets and curves that the filter assumes in its `state`.
    """
    state = ca.SX.sym("state", len(states))
    mechanism = states.context.mechanism
    positions = ca.SX.sym("s", mechanism.n_drives)
    read = ca.SX(positions)
    for d in range(mechanism.n_drives):
        sensor = states.context.position_sensor(d)
        if sensor is not None:
            # the sensor's error at the true position is nearly its error at the reading
            offset = states.context.number(f"{states.context.path(sensor)}.bias")
            read[d] += positions[d] - states.position(d, positions[d], state) + offset
    return ca.Function("read", [positions, state, mechanism.parameters.symbols], [read])


def readings(rig: Rig, positions: Floats) -> Floats:
    """Return the readings of the drives' position sensors at `positions` by the rig file, both (k,
    n_drives) [m, rad].

    Where the filter cannot run on the rig, the positions themselves are returned.
    """
    try:
        states = state_vector(rig)
    except EstimationError:
        return positions
    read = read_function(states).map(len(positions))
    known = states.context.mechanism.parameters.values
    found: Floats = read(positions.T, states.means, known).full().T
    return found

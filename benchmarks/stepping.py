"""Which time step: free-run error of the joint angle against a tight reference, and cost, by scheme
and sub-steps.

`python -m benchmarks.stepping` (part of `make bench`). The rig is `paper-2008-printed`, 3 s with
steps of the load, sampled every 10 ms. The reference is the same friction and stop law with a step
of 0.2 µs.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from benchmarks.report import FOLDER, table
from distal import Rig, load_rig
from distal.model import Kick, Mechanism, damped_inertias, interval_step, kick_and_drift

DT = 0.01
COUNTS = (6, 8, 10, 12, 15, 20, 30, 40)
START = np.array([0.0, 2 / 806, 2 / 806])
Step = ca.Function
"""(q, v, effort, dt, p) → (q⁺, v⁺)."""


def loads() -> np.ndarray:
    """Return pulls on both sliders with steps, (300, 3)."""
    pulls = np.full((300, 3), 2.0)
    pulls[:, 0] = 0.0
    pulls[30:, 1] = 6.0
    pulls[110:, 1], pulls[110:, 2] = 2.0, 5.0
    pulls[190:, 1], pulls[190:, 2] = 4.0, 4.0
    pulls[230:, 1], pulls[230:, 2] = 7.0, 2.5
    return pulls


def leapfrog(mechanism: Mechanism, count: int, rebounds: bool = True) -> Step:
    """Return the package's own step."""
    n = mechanism.n_bodies
    inner = interval_step(mechanism, count, rebounds)
    q, v, effort = (ca.MX.sym(name, n) for name in ("q", "v", "effort"))
    dt, p = ca.MX.sym("dt"), ca.MX.sym("p", len(mechanism.parameters))
    q_next, v_next = inner(q, v, effort, ca.DM.zeros(n), ca.DM.zeros(n, 3), dt, p)
    return ca.Function("leapfrog", [q, v, effort, dt, p], [q_next, v_next])


def euler(mechanism: Mechanism, count: int, implicit: bool) -> Step:
    """Return semi-implicit Euler with the same projection: kick, drift; `implicit` takes own
    stiffness implicitly.
    """
    n, p = mechanism.n_bodies, mechanism.parameters.symbols
    q, v, effort, h = (
        ca.SX.sym(name, size) for name, size in (("q", n), ("v", n), ("effort", n), ("h", 1))
    )
    damped = ca.SX.sym("damped", n)
    own = None
    if implicit:
        jacobian = mechanism.length_jacobian(q)
        stiffness = sum(
            (
                ca.if_else(
                    mechanism.tensions(q, v)[i] > 0,
                    mechanism.parameters[f"tendons.{i}.stiffness"],
                    0,
                )
                * (jacobian[i, :] ** 2).T
                for i in range(mechanism.n_tendons)
            ),
            ca.SX.zeros(n),
        )
        own = ca.horzcat(ca.SX.zeros(n), h * stiffness)
    moved = kick_and_drift(mechanism, Kick(q, v, effort, h, h, own, damped))
    sub = ca.Function("sub", [q, v, effort, damped, h, p], list(moved))
    prepared = ca.Function(
        "damped", [h, p], [damped_inertias(mechanism.dampings(), mechanism.inertias(), h)]
    )
    made: dict[str, object] = {}

    def call(state: tuple[object, object], e: object, h: object, p: object) -> object:
        made.setdefault("damped", prepared(h, p))  # the same in every sub-step
        return sub(*state, e, made["damped"], h, p)

    return _loop("euler", mechanism, count, call)


def stop_force(
    position: ca.SX, velocity: ca.SX, low: ca.SX, high: ca.SX, stiffness: ca.SX, damping: ca.SX
) -> ca.SX:
    """Return F_stop of equation (14), reconstructed; see `distal.model.friction`."""
    above = ca.fmax(stiffness * (position - high) + damping * velocity, 0)
    below = ca.fmin(stiffness * (position - low) + damping * velocity, 0)
    return ca.if_else(position > high, above, 0) + ca.if_else(position < low, below, 0)


def runge_kutta(mechanism: Mechanism, count: int, width: float = 0.01) -> Step:
    """Return classical RK4 with sgn smoothed to tanh(v/ε), ε = `width` rad/s at the joint; stops as
    they are.
    """
    n, p = mechanism.n_bodies, mechanism.parameters
    q, v, effort, h = (
        ca.SX.sym(name, size) for name, size in (("q", n), ("v", n), ("effort", n), ("h", 1))
    )
    tensions = mechanism.tensions(q, v)
    widths = ca.DM([width, *(width * 9.53e-3 for _ in range(n - 1))])
    force = -ca.mtimes(mechanism.length_jacobian(q).T, tensions) + effort - mechanism.dampings() * v
    force -= ca.vertcat(
        *(limit.mean for limit in mechanism.friction_limits(q, v, tensions))
    ) * ca.tanh(v / widths)
    for i, body in enumerate(mechanism.bodies):
        if body.has_stops:
            path = body.path
            low, high = p[f"{path}.stops.low"], p[f"{path}.stops.high"]
            force[i] -= stop_force(
                q[i], v[i], low, high, p[f"{path}.stop_stiffness"], p[f"{path}.stop_damping"]
            )
    state = ca.vertcat(q, v)
    slope = ca.Function(
        "slope", [state, effort, p.symbols], [ca.vertcat(v, force / mechanism.inertias())]
    )
    k1 = slope(state, effort, p.symbols)
    k2 = slope(state + h / 2 * k1, effort, p.symbols)
    k3 = slope(state + h / 2 * k2, effort, p.symbols)
    k4 = slope(state + h * k3, effort, p.symbols)
    moved = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    sub = ca.Function("sub", [q, v, effort, h, p.symbols], [moved[:n], moved[n:]])
    return _loop("rk4", mechanism, count, lambda state, e, h, p: sub(*state, e, h, p))


def _loop(name: str, mechanism: Mechanism, count: int, call: object) -> Step:
    n = mechanism.n_bodies
    q, v, effort = (ca.MX.sym(symbol, n) for symbol in ("q", "v", "effort"))
    dt, p = ca.MX.sym("dt"), ca.MX.sym("p", len(mechanism.parameters))
    state = (q, v)
    for _ in range(count):
        state = call(state, effort, dt / count, p)  # type: ignore[operator]
    return ca.Function(name, [q, v, effort, dt, p], list(state))


def run(step: Step, mechanism: Mechanism, split: int = 1) -> np.ndarray:
    """Return the joint angle at every sample, each interval cut into `split` calls."""
    q, v, p = START, np.zeros(3), mechanism.parameters.values
    angles = []
    for effort in loads():
        for _ in range(split):
            q, v = step(q, v, effort, DT / split, p)
        angles.append(float(q[0]))
    return np.array(angles)


def rms(error: np.ndarray) -> float:
    """Return the RMS in degrees; infinite where the run left all bounds."""
    value = float(np.rad2deg(np.sqrt(np.mean(error**2))))
    return value if np.isfinite(value) and value < 1e3 else float("inf")


SCHEMES = {
    "kick–drift–kick, stops rebound (in use)": lambda m, n: leapfrog(m, n),
    "kick–drift–kick, stops pressed (in filters)": lambda m, n: leapfrog(m, n, rebounds=False),
    "semi-implicit Euler, projected": lambda m, n: euler(m, n, implicit=False),
    "the same, stiffness implicit": lambda m, n: euler(m, n, implicit=True),
    "RK4, friction as tanh": lambda m, n: runge_kutta(m, n),
}


def rig(stops: list[str]) -> Rig:
    """Return the paper's rig with other stops."""
    return load_rig("paper-2008-printed").with_values(
        {"drives.0.stops": stops, "drives.1.stops": stops}
    )


def main() -> None:
    """Measure, print and save."""
    cases = {"free": rig(["-40 mm", "40 mm"]), "stops": rig(["-2.5 mm", "7.5 mm"])}
    errors: dict[str, dict[str, list[float]]] = {}
    for case, description in cases.items():
        mechanism = Mechanism(description)
        reference = run(leapfrog(mechanism, 1000, rebounds=False), mechanism, split=50)
        coarser = run(leapfrog(mechanism, 500, rebounds=False), mechanism, split=50)
        print(
            f"{case}: the reference's own error, from a step twice as long: "
            f"{rms(coarser - reference):.4f}°"
        )
        for name, make in SCHEMES.items():
            values = [rms(run(make(mechanism, n), mechanism) - reference) for n in COUNTS]
            errors.setdefault(name, {})[case] = values
    show = lambda value: f"{value:.3f}" if np.isfinite(value) else "∞"  # noqa: E731
    rows = [
        [name, *(f"{show(free)} / {show(stops)}" for free, stops in zip(by["free"], by["stops"]))]
        for name, by in errors.items()
    ]
    title = "RMS error of the joint angle [°], free / into the stops, by sub-steps per 10 ms"
    table("stepping", title, ["scheme", *map(str, COUNTS)], rows)
    picture(errors)


def picture(errors: dict[str, dict[str, list[float]]]) -> None:
    """Draw the errors over the sub-steps."""
    from distal.results import COLOURS, figure, save_figure

    with figure(1, 2, (7.2, 3.4), sharey=True) as (made, axes):
        for axis, case, title in zip(
            axes, ("free", "stops"), ("free motion", "driven into the stops")
        ):
            for i, (name, by) in enumerate(errors.items()):
                axis.loglog(
                    COUNTS,
                    by[case],
                    marker="osD^v"[i],
                    markersize=4,
                    color=COLOURS[i],
                    linewidth=1,
                    label=name,
                )
            axis.set_title(title, loc="left", fontsize=9)
            axis.set_xlabel("sub-steps per 10 ms")
            axis.set_xticks(COUNTS, map(str, COUNTS))
            axis.minorticks_off()
            axis.set_ylim(1e-3, 30)
        axes[0].set_ylabel("RMS error of θ [°]")
        made.legend(
            *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8
        )
    save_figure(made, FOLDER / "stepping.svg")
    save_figure(made, FOLDER / "stepping.png")


if __name__ == "__main__":
    main()

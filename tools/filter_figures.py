"""Figures of docs/explanation/adaptive.md: `python -m tools.filter_figures` writes filter-*.svg to
docs/figures.

Each curve is what distal's simulation, its filter or a function of the filter gives. `--png FOLDER`
writes PNG, to look at.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from distal import Log, Rig, Scenario, estimate, load_scenario, scenario_rig, simulate, smooth
from distal.arrays import Floats
from distal.confidence import BAND
from distal.estimators import AdaptiveFilter, Robustness
from distal.estimators.adaptive.drive_tracking import Drive, tracking
from distal.estimators.adaptive.filter_function import adaptive_layout
from distal.estimators.adaptive.update import ROW, SLOW_DECLARED, motion_of, rows_function
from distal.model import Kick, Mechanism, kicked, loads_of
from distal.results import (
    BLACK,
    COLOURS,
    DASHES,
    SOFT,
    band_colour,
    figure,
    legend_above,
    save_figure,
)
from distal.simulation import build_scenario

FOLDER = Path("docs/figures")
BLUE, RED, GREEN, PINK = COLOURS[:4]


@dataclass(frozen=True)
class Step:
    """What the filter made of one sample.

    Args:
        mean: after the sample, (n,).
        variances: of the states, (n,).
        predicted: mean before the sample, (n,).
        tracks: of each drive.
        values: of each row that is compared, a `ROW`.
        innovations: ν, NaN where none, (m,).
        spreads: S, (m,).
    """

    mean: Floats
    variances: Floats
    predicted: Floats
    tracks: list[Drive]
    values: list[dict[str, float]]
    innovations: Floats
    spreads: Floats


def steps(log: Log, rig: Rig, robustness: Robustness | None = None) -> list[Step]:
    """Return what the filter makes of a log, sample by sample, with the numbers inside of it."""
    estimator = AdaptiveFilter(rig, robustness=robustness, trace=True)
    states = estimator.states
    n, m = len(states), len(estimator.measured)
    layout = adaptive_layout(states)
    track, (rows, compared) = tracking(states), rows_function(states)
    samples = np.column_stack([log.channels[name] for name in estimator.channels])
    belief = estimator.initial(log.time[0], samples[0])
    kernel_states, ys = estimator.advanced(belief, log.time, samples)
    means, covariances, innovations, spreads = estimator.scan(belief, log.time, samples)
    last, taken = log.time[0], list[Step]()
    for k, (time, sample) in enumerate(zip(log.time, samples)):
        before = kernel_states[k - 1] if k else belief.kernel_state
        x = np.concatenate([[time - last], np.nan_to_num(sample), np.isfinite(sample)])
        mean, memory = (np.array(layout.part(ca.DM(before), name)) for name in ("mean", "drives"))
        tracks = np.array(track(mean, memory, x, estimator.parameters))
        drives = [Drive(*column) for column in tracks.T]
        predicted = ys[k, 2 * m : 2 * m + n]
        rates = [(d.position - old) / max(time - last, 1e-9) for d, old in zip(drives, memory[0])]
        found = compared(predicted, tracks, rates, x, estimator.parameters)
        each = [np.array(found[i]).ravel() for i in range(len(rows))]
        values = [{part: float(row[i]) for i, part in enumerate(ROW.names)} for row in each]
        variances = np.diag(covariances[k])
        taken.append(
            Step(
                means[k],
                variances,
                predicted,
                drives,
                values,
                innovations[k],
                spreads[k],
            )
        )
        last = time
    return taken


def changed(scenario: Scenario, **values: object) -> Scenario:
    """Return a scenario with other values at its top level."""
    return build_scenario({**scenario.model_dump(exclude_defaults=True), **values})


def to_and_fro() -> tuple[Scenario, Rig, Log]:
    """Return the scenario of the template of rig files, its rig and a log."""
    scenario = load_scenario("template")
    rig = scenario_rig(scenario)
    return scenario, rig, simulate(rig, scenario)


def spoiled(log: Log, **readings: tuple[int, float]) -> Log:
    """Return a log with something added to a reading of each of these sensors from an index on, for
    one sample.
    """
    channels = {name: values.copy() for name, values in log.channels.items()}
    for name, (at, added) in readings.items():
        channels[name][at] += added
    return replace(log, channels=channels)


def band(axes: Axes, time: Floats, middle: Floats, half: Floats, colour: str, label: str) -> None:
    """Shade a 95 % band, of a long log at every fifth sample."""
    if len(time) > 1000:
        time, middle, half = time[::5], middle[::5], half[::5]
    axes.fill_between(
        time, middle - half, middle + half, color=band_colour(colour), lw=0, label=label
    )


def idea() -> Figure:
    """Displacements go in, forces are compared, the angle comes out."""
    _, rig, log = to_and_fro()
    result, t = estimate(log, rig), log.time
    true = np.rad2deg(log.truth["theta"])
    with figure(4, 1, (6.5, 6.4), sharex=True) as (made, axes):
        for i, side in enumerate(("left", "right")):
            look = {"color": COLOURS[i], "ls": DASHES[i], "lw": 1.3}
            axes[0].plot(t, 1e3 * log.channels[f"x{i + 1}"], label=f"{side} drive", **look)
        force, expected = log.channels["u1"], log.channels["u1"] - result.innovations[:, 0]
        axes[1].plot(
            t[::4], force[::4], ".", color=SOFT, ms=2.5, label="measured, left drive (every fourth)"
        )
        axes[1].plot(t, expected, color=BLUE, lw=1.1, label="expected from the predicted state")
        angle, half = np.rad2deg(result.angles[:, 0]), np.rad2deg(BAND * result.angle_stds[:, 0])
        axes[2].plot(t, true, color=BLACK, lw=1.6, label="true")
        axes[2].plot(t, angle, color=RED, ls=DASHES[1], lw=1.2, label="estimated")
        axes[3].plot(t, angle - true, color=RED, lw=1.0, label="estimated less true")
        band(axes[3], t, 0 * t, half, RED, "95 % band")
        axes[3].set_ylim(-1.5, 1.5)
        axes[3].set_xlim(0, 20)
        labels = (
            "input:\ndisplacement [mm]",
            "measurement:\nforce [N]",
            "result:\nangle [°]",
            "its error [°]",
        )
        for one, label in zip(axes, labels):
            one.set_ylabel(label)
            legend_above(one)
        axes[3].set_xlabel("time [s]")
        made.align_ylabels()
    return made


def jump() -> Figure:
    """An outlier, a jump that is real, and a reading that is missing: reading, tracked place, its
    std.
    """
    scenario = load_scenario("template")
    rig = scenario_rig(scenario)
    steady, moved = [["0 s", "2 mm"], ["1.3 s", "2 mm"]], [["1.302 s", "4 mm"], ["3 s", "4 mm"]]
    servos = {
        "left": {"servo": {"position": steady + moved}},
        "right": {"servo": {"position": [["0 s", "2 mm"], ["3 s", "2 mm"]]}},
    }
    log = spoiled(simulate(rig, changed(scenario, drives=servos, duration="2 s")), x1=(110, 2e-3))
    log.channels["x1"].flags.writeable = True
    log.channels["x1"][150:160] = np.nan
    log.channels["x1"].flags.writeable = False
    taken, t = steps(log, rig), log.time
    position = 1e3 * np.array([step.tracks[0].position for step in taken])
    std = 1e3 * np.sqrt([step.tracks[0].variance for step in taken])
    with figure(2, 1, (6.5, 4.0), sharex=True, height_ratios=(2, 1)) as (made, axes):
        axes[0].plot(
            t, 1e3 * log.channels["x1"], "o", ms=4, mfc="none", color=SOFT, label="reading"
        )
        axes[0].plot(t, 1e3 * log.truth["position_left"], color=BLACK, lw=1.0, label="true")
        axes[0].plot(t, position, color=BLUE, ls=DASHES[1], lw=1.5, label="tracked place")
        band(axes[0], t, position, BAND * std, BLUE, "95 % band")
        for at, height, text in (
            (1.1, 3.64, "outlier"),
            (1.31, 2.5, "real jump"),
            (1.49, 2.65, "readings missing"),
        ):
            axes[0].annotate(
                text,
                (at, height),
                xytext=(7, 0),
                textcoords="offset points",
                fontsize=8,
                va="center",
            )
        axes[1].semilogy(t, std, color=BLUE)
        axes[0].set_ylabel("place of the\nleft drive [mm]")
        axes[1].set_ylabel("its std [mm]")
        axes[1].set_xlabel("time [s]")
        axes[0].set_xlim(1.0, 1.8)
        legend_above(axes[0])
    return made


def prediction() -> Figure:
    """Between two samples: the joint by the model, with short and long sub-steps, each interval
    from the truth.
    """
    scenario = load_scenario("template")
    fine, n, per = scenario_rig(scenario, ["sensors.*.rate=1000", "sensors.*.noise=0.0"]), 1, 100
    servo = [["0 s", "2 mm"], ["1 s", "2 mm"], ["1.05 s", "6 mm"], ["3 s", "6 mm"]]
    other = [["0 s", "2 mm"], ["1 s", "2 mm"], ["1.05 s", "-2 mm"], ["3 s", "-2 mm"]]
    servos = {"left": {"servo": {"position": servo}}, "right": {"servo": {"position": other}}}
    plain = {
        name: value
        for name, value in scenario.model_dump(exclude_defaults=True).items()
        if name != "plant"
    }
    log = simulate(fine, build_scenario({**plain, "drives": servos, "duration": "2 s"}))
    mechanism, h = Mechanism(fine), ca.SX.sym("h")
    q, v = ca.SX.sym("q", mechanism.n_bodies), ca.SX.sym("v", mechanism.n_bodies)
    kick = Kick(q, v, ca.SX.zeros(mechanism.n_bodies, 1), h, h)
    link = kicked(mechanism, kick, loads_of(mechanism, kick))
    p = mechanism.parameters
    moved = [ca.vertcat(link.q, q[n:] + h * v[n:]), ca.vertcat(link.v, v[n:])]
    function = ca.Function("step", [q, v, h, p.symbols], moved)
    positions = np.column_stack([log.truth["position_left"], log.truth["position_right"]])
    angle, t = log.truth["theta"], log.time
    speed = np.gradient(angle, t)

    def led(start: int, count: int) -> tuple[Floats, Floats]:
        """Return times and angles of one interval from the truth at its start."""
        length, s = t[start + per] - t[start], positions[start].copy()
        rates, state, rate = (positions[start + per] - s) / length, angle[start], speed[start]
        times, angles = [t[start]], [state]
        for _ in range(count):
            ends = function([state, *s], [rate, *rates], length / count, p.values)
            state, rate = (float(end[0]) for end in ends)
            s = s + rates * length / count
            times.append(times[-1] + length / count)
            angles.append(state)
        return np.array(times), np.array(angles)

    with figure(2, 1, (6.5, 4.4), sharex=True, height_ratios=(1, 2)) as (made, axes):
        axes[0].plot(t, 1e3 * positions[:, 0], color=BLACK, lw=1.4, label="true")
        axes[0].plot(
            t[::per],
            1e3 * positions[::per, 0],
            "o-",
            color=BLUE,
            ms=4,
            lw=1.0,
            label="samples, straight lines",
        )
        axes[1].plot(t, np.rad2deg(angle), color=BLACK, lw=1.6, label="true")
        for k, (count, text) in enumerate(((40, "sub-steps of 2.5 ms"), (2, "sub-steps of 50 ms"))):
            for start in range(900, 1600, per):
                times, angles = led(start, count)
                look = {
                    "color": (BLUE, RED)[k],
                    "ls": DASHES[k + 1],
                    "lw": 1.4,
                    "marker": ("", "s")[k],
                    "ms": 3.5,
                }
                axes[1].plot(
                    times, np.rad2deg(angles), label=text if start == 900 else None, **look
                )
        axes[1].plot(t[::per], np.rad2deg(angle[::per]), "o", color=BLACK, ms=4.5, label="samples")
        axes[0].set_ylabel("place of the\nleft drive [mm]")
        axes[1].set_ylabel("angle [°]")
        axes[1].set_xlabel("time [s]")
        axes[1].set_xlim(0.9, 1.4)
        for one in axes:
            legend_above(one)
    return made


def play() -> Figure:
    """The effort of a grasper's motor and what its transmission passes on."""
    wave = [
        [f"{k} s", f"{angle} deg"] for k, angle in enumerate((85.7, 85.7, 60, 78, 40, 65, 50, 85.7))
    ]
    hand = {"hand": {"angle": "78 deg", "stiffness": "0.5 N m/rad"}}
    raw = {"rig": "da-vinci-grasper", "name": "a jaw that is held", "duration": "7 s"}
    scenario = build_scenario(
        {**raw, "drives": {"motor": {"servo": {"angle": wave}}}, "joints": {"jaw": hand}}
    )
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario)
    result, t = estimate(log, rig), log.time
    effort = log.channels[next(s.name for s in rig.sensors_of("force"))]
    at = next(i for i, name in enumerate(result.state_names) if name.startswith("transmitted"))
    passed = result.means[:, at]
    with figure(1, 2, (6.5, 3.1), width_ratios=(1.6, 1)) as (made, axes):
        axes[0].plot(t, 1e3 * effort, color=SOFT, lw=1.0, label="effort, measured")
        axes[0].plot(
            t, 1e3 * passed, color=BLUE, ls=DASHES[1], lw=1.5, label="passed on, estimated"
        )
        axes[0].set_xlabel("time [s]")
        axes[0].set_ylabel("torque [mN m]")
        axes[1].plot(1e3 * effort, 1e3 * passed, color=BLUE, lw=0.9)
        ends = np.array([min(effort.min(), passed.min()), max(effort.max(), passed.max())]) * 1e3
        axes[1].plot(ends, ends, color=SOFT, ls=DASHES[2], lw=1.0, label="without a play")
        axes[1].set_xlabel("effort [mN m]")
        axes[1].set_ylabel("passed on [mN m]")
        for one in axes:
            legend_above(one, most=2)
    return made


def friction() -> Figure:
    """How a drive moves, and its force before friction is taken into account, against its
    direction.
    """
    _, rig, log = to_and_fro()
    sensor = rig.sensors_of("position")[0]
    taken, t = steps(log, rig), log.time
    motions = [motion_of(step.tracks[0], sensor.noise**2, 0.01, SLOW_DECLARED) for step in taken]
    d, kappa = (
        np.array([float(getattr(m, name)) for m in motions]) for name in ("direction", "stuck")
    )
    residual, limit = (
        np.array([step.values[0][name] for step in taken]) for name in ("value", "limit")
    )
    with figure(1, 2, (6.5, 3.4), width_ratios=(1.35, 1)) as (made, axes):
        axes[0].plot(t, d, color=BLUE, lw=1.2, label="direction d")
        axes[0].plot(t, kappa, color=RED, ls=DASHES[1], lw=1.1, label="sticking κ")
        axes[0].set_xlabel("time [s]")
        axes[0].set_ylabel("d, κ [1]")
        axes[0].set_xlim(0, 7)
        sticks, later = kappa > 0.5, (t > 1.0) & (np.arange(len(t)) % 2 == 0)
        axes[1].plot(
            d[later & ~sticks], residual[later & ~sticks], ".", color=BLUE, ms=3, label="slips"
        )
        axes[1].plot(
            d[later & sticks], residual[later & sticks], "x", color=RED, ms=4, label="sticks"
        )
        size = float(np.median(limit[later]))
        ends = np.array([-1.0, 1.0])
        axes[1].plot(ends, size * ends, color=BLACK, lw=1.3, ls=DASHES[3], label="d · l")
        for side in (-size, size):
            axes[1].axhline(
                side, color=SOFT, ls=DASHES[2], lw=1.1, label="±l" if side > 0 else None
            )
        axes[1].set_xlabel("direction d [1]")
        axes[1].set_ylabel("force less expected pull [N]")
        for one in axes:
            legend_above(one, most=2)
    return made


def learning() -> Figure:
    """A parameter with the whole gain and with a share of it; the plant has twice the constant
    friction of the rig.
    """
    scenario = load_scenario("template")
    rig, constants = (
        scenario_rig(scenario),
        {f"drives.{side}.friction.constant": "0.2 N" for side in ("left", "right")},
    )
    log = simulate(rig, scenario.model_copy(update={"plant": {**scenario.plant, **constants}}))
    at, t = AdaptiveFilter(rig).state_names.index("friction load of drive left"), log.time
    whole = replace(Robustness(), learning_time=0.0)
    with figure(1, 1, (6.5, 3.2)) as (made, (axes,)):
        for k, (guards, text) in enumerate(
            ((whole, "whole gain"), (Robustness(), "share of the gain"))
        ):
            taken = steps(log, rig, guards)
            value, std = (
                np.array([getattr(step, name)[at] for step in taken])
                for name in ("mean", "variances")
            )
            axes.plot(t, value, color=(RED, BLUE)[k], ls=DASHES[1 - k], lw=1.4, label=text)
            band(axes, t, value, BAND * np.sqrt(std), (RED, BLUE)[k], "95 % band")
        axes.axhline(0.03, color=BLACK, ls=DASHES[2], lw=1.4, label="true")
        axes.set_xlabel("time [s]")
        axes.set_ylabel("friction of the left drive\nper load [1]")
        axes.set_xlim(0, 20)
        legend_above(axes, most=5)
    return made


def outlier() -> Figure:
    """A wild force: its innovation against ±3 √S, and the angle with and without the capped
    gain.
    """
    _, rig, log = to_and_fro()
    log, t = spoiled(log, u1=(650, 20.0)), log.time
    guarded, trusting = steps(log, rig), steps(log, rig, replace(Robustness(), wild_force=np.inf))
    span = (t > 6.2) & (t < 7.2)
    truth = np.rad2deg(log.truth["theta"])
    with figure(2, 1, (6.5, 4.2), sharex=True) as (made, axes):
        innovation = np.array([step.innovations[0] for step in guarded])
        reach = 3 * np.sqrt([step.spreads[0] for step in guarded])
        axes[0].plot(
            t[span], innovation[span], ".-", color=BLUE, lw=0.8, ms=3, label="innovation ν"
        )
        axes[0].fill_between(
            t[span], -reach[span], reach[span], color=band_colour(SOFT), lw=0, label="±3 √S"
        )
        for taken, colour, dash, text in (
            (trusting, RED, DASHES[1], "gain by S"),
            (guarded, BLUE, DASHES[0], "gain by S'"),
        ):
            error = np.rad2deg([step.mean[0] for step in taken]) - truth
            axes[1].plot(t[span], error[span], color=colour, ls=dash, lw=1.4, label=text)
        axes[0].set_ylabel("innovation of the\nleft force [N]")
        axes[1].set_ylabel("error of the angle [°]")
        axes[1].set_xlabel("time [s]")
        for one in axes:
            legend_above(one)
    return made


def smoother() -> Figure:
    """The error of the angle, filtered and smoothed, where readings are missing for a while."""
    _, rig, log = to_and_fro()
    channels = {name: values.copy() for name, values in log.channels.items()}
    gone = (log.time > 6) & (log.time < 6.2)
    for values in channels.values():
        values[gone] = np.nan
    log, t = replace(log, channels=channels), log.time
    truth, shown = np.rad2deg(log.truth["theta"]), (t > 3.5) & (t < 9)
    with figure(2, 1, (6.5, 4.2), sharex=True, sharey=True) as (made, axes):
        for one, result, colour, text in zip(
            axes, (estimate(log, rig), smooth(log, rig)), (RED, BLUE), ("filtered", "smoothed")
        ):
            error, half = (
                np.rad2deg(result.angles[:, 0]) - truth,
                BAND * np.rad2deg(result.angle_stds[:, 0]),
            )
            one.plot(t[shown], error[shown], color=colour, lw=1.2, label=text)
            band(one, t[shown], 0 * t[shown], half[shown], colour, "95 % band")
            one.axvspan(6, 6.2, color=SOFT, alpha=0.12, lw=0, label="no readings")
            one.set_ylabel("error of the\nangle [°]")
            legend_above(one)
        axes[1].set_xlabel("time [s]")
        axes[1].set_xlim(3.5, 9)
    return made


FIGURES: dict[str, Callable[[], Figure]] = {
    "idea": idea,
    "jump": jump,
    "prediction": prediction,
    "play": play,
    "friction": friction,
    "learning": learning,
    "outlier": outlier,
    "smoother": smoother,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Write all figures, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"which of {', '.join(FIGURES)}; default all")
    parser.add_argument("--png", type=Path, help="a folder for PNG instead of docs/figures")
    given = parser.parse_args(arguments)
    for name in given.names or FIGURES:
        target = (
            FOLDER / f"filter-{name}.svg" if given.png is None else given.png / f"filter-{name}.png"
        )
        save_figure(FIGURES[name](), target)


if __name__ == "__main__":
    main()

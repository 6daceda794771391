"""The 2008 paper, reproduced: its two test series, simulated on a plant and filtered with the
parameters of its Table 1; its statements C1 to C12, each as measures of simulated runs with
thresholds that were written down before the first run; its figures 2 to 5; and a page with all
of them.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from html import escape
from itertools import product
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter

from distal.arrays import Floats
from distal.confidence import BAND, COVERED_TEXT
from distal.estimators import KernelEstimator, make_estimator
from distal.estimators.paper_2008 import FullStateFilter, Noise, paper_noise
from distal.logs import Log, check_outputs, write_together
from distal.model import Mechanism
from distal.reports.page import heading, page, paragraph, picture, resource, svg_of
from distal.reports.rig_drawing import rig_svg
from distal.results import (
    BLACK,
    SOFT,
    TRUTH,
    Estimate,
    Html,
    band_colour,
    curve_style,
    figure,
    figure_bytes,
    html_table,
    make_folder,
    verdict,
)
from distal.rig import load_rig, number, tendon_angle_name
from distal.run import estimate
from distal.simulation import Scenario, load_scenario, scenario_rig
from distal.simulation.simulate import motions_of, prepare, sampled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SERIES_1 = ("series-1-soft", "series-1")
"""Scenarios of Series 1, in which a hand moves the link, with softer and stiffer tendons."""

SERIES_2 = ("series-2", "series-2-medium", "series-2-high")
"""Scenarios of Series 2, in which weights move the link, at rising tension."""

SEEDS = (0, 1, 2, 3, 4)
"""Seeds of the sensors' errors. Source: judgement."""

X_OVER_R = {f"tendons.{i}.insertion": {"kind": "pulley", "radius": "9.53 mm"} for i in (0, 1)}
"""Insertions of the tendons for an estimate that takes the angle as x/r, instead of from the
geometry.
"""

IDEAL = {"sensors.x1.linearity": 0.0, "sensors.x2.linearity": 0.0}
"""Parameters of potentiometers that are linear."""

BETTER_CELLS = {"sensors.u1.noise": "0.03 N", "sensors.u2.noise": "0.03 N"}
"""Parameters of load cells with less noise."""


@dataclass(frozen=True)
class Plant:
    """A rig that the paper's authors may have had; the filters know only Table 1.

    Args:
        values: path → value, of the rig's parameters that differ from Table 1.
        over_radius: whether the inextensible estimate takes the angle as x/r, instead of from the
            geometry.
    """

    name: str
    values: dict[str, object] = field(default_factory=dict)
    over_radius: bool = False

    def scenario(self, series: str) -> Scenario:
        """Return a shipped scenario on this plant.

        Args:
            series: name of the scenario, one of `SERIES_1` or `SERIES_2`.
        """
        return load_scenario(series).model_copy(update={"plant": self.values})


def observed_values() -> dict[str, object]:
    """Return path → value of the friction by which the shipped rig `paper-2008-observed` differs
    from Table 1.
    """
    rig = load_rig("paper-2008-observed")
    axle = rig.joints[0].friction
    assert axle is not None
    paths = ["joints.0.friction.preload", "joints.0.friction.exponent"]
    paths += [f"drives.{i}.friction.{key}" for i in (0, 1) for key in ("constant", "load")]
    values: dict[str, object] = {path: number(rig, path).value for path in paths}
    return values | {"joints.0.friction.reference": axle.reference}


PLANTS = (
    Plant("friction of Table 1", over_radius=True),
    Plant("more friction", observed_values(), over_radius=True),
)
"""The plants of the reproduction: Table 1 taken literally, and the plant on which most statements
hold.

The second comes from `python -m benchmarks.paper_search`: its result, rounded, is in the rig, in
the angle of Series 1 in the scenario files, and in the reading of the inextensible estimate.
"""


@dataclass(frozen=True)
class SeriesRun:
    """One simulated test, and the estimates of all estimators.

    Args:
        series: name of the scenario.
        plant: name of the plant.
        log: the simulated log.
        estimates: name of an estimator or of a variant → its estimate.
    """

    series: str
    plant: str
    log: Log
    estimates: dict[str, Estimate]


@lru_cache(maxsize=64)
def _estimator(series: str, name: str) -> KernelEstimator:
    """Return an estimator of a series that knows only Table 1; it is built once for all plants."""
    rig = scenario_rig(load_scenario(series))
    if name == "x/r":
        return make_estimator("inextensible", rig.with_values(X_OVER_R))
    if (
        name == "simulation"
    ):  # the model driven by the measured forces; with zero covariance it learns nothing
        noise = paper_noise(rig)
        inputs, process, initial = map(np.zeros_like, (noise.inputs, noise.process, noise.initial))
        return FullStateFilter(
            "simulation", rig, Noise(inputs, process, noise.measurements, initial)
        )
    return make_estimator(name, rig)


def run_series(
    series: str, plant: Plant, seeds: Sequence[int] = SEEDS, *, statements_only: bool = False
) -> list[SeriesRun]:
    """Return one test of the paper on a plant, simulated with each seed and estimated.

    The motion does not depend on the seed or the sensors, so it is simulated once.

    Args:
        series: name of the scenario.
        seeds: seeds of the sensors' errors.
        statements_only: whether estimators that no statement needs are left out.
    """
    scenario = plant.scenario(series)
    rig = scenario_rig(scenario)
    ready = prepare(rig, scenario)
    (motion,) = motions_of([ready])

    def read(seed: int, sensors: Mapping[str, object] | None = None) -> Log:
        plant = (
            Mechanism(ready.plant.rig.with_values(sensors), remembers=True)
            if sensors
            else ready.plant
        )
        return sampled(replace(ready, plant=plant), motion, seed)

    inextensible = _estimator(series, "x/r" if plant.over_radius else "inextensible")
    knowing = make_estimator("ekf-2008", rig.with_values(plant.values or observed_values()))
    runs = []
    for seed in seeds:
        log = read(seed)
        asked = {"inextensible": (log, inextensible)}
        if series in SERIES_1:
            asked["without linearity"] = (read(seed, IDEAL), inextensible)
        else:
            names = ("ekf-2008", "simulation", *(() if statements_only else ("ekf", "adaptive")))
            asked |= {name: (log, _estimator(series, name)) for name in names}
            asked["observed friction"] = (log, knowing)
        if series == "series-2":
            paper = _estimator(series, "ekf-2008")
            asked["hung weights"] = (hung_weights(log, scenario), paper)
            asked["better cells"] = (read(seed, BETTER_CELLS), paper)
        estimates = {name: estimate(of, rig, by) for name, (of, by) in asked.items()}
        runs.append(SeriesRun(series, plant.name, log, estimates))
    return runs


def hung_weights(log: Log, scenario: Scenario) -> Log:
    """Return a log in which the scenario's hung weights replace the readings of the load cells."""
    channels = dict(log.channels)
    for sensor, drive in (("u1", "left"), ("u2", "right")):
        weight = scenario.drives[drive].weight
        if weight is not None:
            channels[sensor] = weight.at(log.time)
    return replace(log, channels=channels)


TESTS = tuple(product(PLANTS, (*SERIES_1, *SERIES_2)))
"""The tests of the reproduction: a plant and a scenario each."""


PlantRuns = Sequence[SeriesRun]
"""Runs of one plant."""

Values = tuple[float, ...]
"""Values of the measures of a statement, in their order."""

Runs = dict[str, list[SeriesRun]]
"""Name of a plant → its runs."""


SIDES = ("left", "right")
"""Names of the two tendons and their sliders."""


@dataclass(frozen=True)
class Measure:
    """One measured quantity of a statement, described by `text`; it holds from `least` to `most`,
    where these are not None.
    """

    text: str
    least: float | None = None
    most: float | None = None

    def margin(self, value: float) -> float:
        """Return how far a value is inside its bound, as a share of the bound.

        The margin is negative outside the bound, and −∞ where the value is not finite.
        """
        if not np.isfinite(value):
            return -np.inf
        above = [] if self.least is None else [(value - self.least) / abs(self.least)]
        below = [] if self.most is None else [(self.most - value) / abs(self.most)]
        return min(above + below)


@dataclass(frozen=True)
class Statement:
    """A statement of the paper.

    Args:
        key: ``C1`` to ``C12``.
        text: the statement in words.
        why: the reason for the threshold.
        reason: why it holds on a plant or not.
        measures: its measures, the main one first; all must be within their bounds.
    """

    key: str
    text: str
    why: str
    reason: str
    measures: tuple[Measure, ...]

    def margin(self, values: Sequence[float]) -> float:
        """Return the smallest margin of the measures at their `values`; the statement holds where
        it is not negative.
        """
        return min(measure.margin(value) for measure, value in zip(self.measures, values))


@lru_cache(maxsize=1)
def statements() -> tuple[Statement, ...]:
    """Return the paper's statements with the thresholds of `paper_2008_claims.toml`."""
    described = tomllib.loads(resource("paper_2008_claims.toml"))
    return TypeAdapter(tuple[Statement, ...]).validate_python(described["statements"])


def measured(runs: PlantRuns) -> dict[str, Values]:
    """Return key of a statement → values of its measures, from the runs of one plant."""
    values = {key: measure(runs) for key, measure in _MEASURES.items()}
    for key, (series, estimator, over, other) in _RATIOS.items():
        values[key] = (rms(runs, series, estimator) / rms(runs, over, other),)
    return values


@dataclass(frozen=True)
class Claim:
    """A statement, and the values of its measures on each plant of the reproduction, by the plant's
    name.
    """

    statement: Statement
    values: Mapping[str, Values]

    def holds(self, plant: str) -> bool:
        """Return whether the statement holds on a plant: whether all its measures are within their
        bounds.
        """
        return self.statement.margin(self.values[plant]) >= 0.0

    @property
    def group(self) -> str:
        """The one of `GROUPS` to which the statement belongs."""
        printed, observed = (self.holds(plant.name) for plant in PLANTS)
        return GROUPS[2] if not observed else GROUPS[0] if printed else GROUPS[1]


GROUPS = ("reproduced", "only with friction that the paper did not know of", "contradicted")
"""Groups of statements: those that hold on both plants, those that hold only on the plant with more
friction, and those that do not hold on the latter.
"""


def _pooled(errors: Sequence[Floats]) -> float:
    """Return the RMS of several errors [rad] over all their samples [°]."""
    return degrees(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))


def rms(runs: PlantRuns, series: str, estimator: str) -> float:
    """Return the RMS error of an estimator in a series, pooled over all samples and seeds [°].

    Args:
        series: name of the scenario.
        estimator: a key of `SeriesRun.estimates`.
    """
    return _pooled([run.estimates[estimator].errors() for run in _of(runs, series)])


def _of(runs: PlantRuns, series: str) -> list[SeriesRun]:
    return [run for run in runs if run.series == series]


def potentiometer_errors(run: SeriesRun) -> list[Floats]:
    """Return the errors of the angles by the left and the right potentiometer [rad], (n,) each.

    The tendons are taken as inextensible.
    """
    estimate = run.estimates["inextensible"]
    return [estimate.state(tendon_angle_name(side)) - run.log.truth["theta"] for side in SIDES]


def _potentiometer_rms(runs: PlantRuns, series: str) -> list[float]:
    return [_pooled(errors) for errors in zip(*map(potentiometer_errors, _of(runs, series)))]


def _c1(runs: PlantRuns) -> Values:
    return (min(_potentiometer_rms(runs, "series-1-soft")),)


def _c2(runs: PlantRuns) -> Values:
    opposing = []
    assisting = []
    for run in _of(runs, "series-1-soft"):
        left, right = potentiometer_errors(run)
        speed = np.gradient(run.log.truth["theta"], run.log.time)
        down = speed < np.deg2rad(-2.0)
        up = speed > np.deg2rad(2.0)
        # the left tendon pulls to +θ: it opposes a falling angle
        opposing += [left[down], right[up]]
        assisting += [right[down], left[up]]
    return (_pooled(opposing) / _pooled(assisting),)


def _c3(runs: PlantRuns) -> Values:
    soft, stiff = (float(np.mean(_potentiometer_rms(runs, series))) for series in SERIES_1)
    alike = [
        np.corrcoef(
            a.estimates["inextensible"].means[:, i], b.estimates["inextensible"].means[:, i]
        )[0, 1]
        for a, b in zip(_of(runs, "series-1-soft"), _of(runs, "series-1"))
        for i in (1, 2)
    ]
    return stiff / soft, stiff, float(np.mean(alike))


def _c4(runs: PlantRuns) -> Values:
    motions = [
        hidden_motion(run.log.truth["theta"], run.log.truth[f"position_{side}"])
        for run in _of(runs, "series-1-soft")
        for side in SIDES
    ]
    return (degrees(max(motions)),)


def hidden_motion(theta: Floats, position: Floats) -> float:
    """Return the largest change of the joint angle while a slider stays within 0.1 mm [rad].

    Args:
        theta: joint angle [rad], (n,).
        position: position of the slider [m], (n,).
    """
    largest = 0.0
    start = 0
    for end in range(len(theta)):
        while np.ptp(position[start : end + 1]) > 1e-4:
            start += 1
        largest = max(largest, np.ptp(theta[start : end + 1]))
    return largest


def _c8(runs: PlantRuns) -> Values:
    def beyond(series: str) -> float:
        """Return the error of the free simulation at the end [°]."""
        errors = [run.estimates["simulation"].errors()[-50:] for run in _of(runs, series)]
        return degrees(np.mean(errors))

    low = beyond("series-2")
    high = beyond("series-2-high")
    return high, rms(runs, "series-2", "simulation"), high / low if low > 0.0 else np.nan


def _c9(runs: PlantRuns) -> Values:
    changes = [
        run.estimates["inextensible"].means - run.estimates["without linearity"].means
        for run in _of(runs, "series-1")
    ]
    return (_pooled([change[:, 1:3] for change in changes]),)


_MEASURES = {"C1": _c1, "C2": _c2, "C3": _c3, "C4": _c4, "C8": _c8, "C9": _c9}
"""Key of a statement → function that measures it."""

_RATIOS = {
    "C5": ("series-2", "ekf-2008", "series-2", "inextensible"),
    "C6": ("series-2-high", "inextensible", "series-2", "inextensible"),
    "C7": ("series-2-high", "ekf-2008", "series-2-high", "inextensible"),
    "C10": ("series-2", "ekf-2008", "series-2", "hung weights"),
    "C11": ("series-2", "better cells", "series-2", "ekf-2008"),
    "C12": ("series-2", "observed friction", "series-2", "ekf-2008"),
}
"""Key of a statement → series and estimator whose RMS error is divided by that of another pair."""

FIGURES = {
    "figure-2": (
        "series-1-soft",
        "Series 1: the link is moved by hand, 2 N on each tendon, k = 403 N/m. The angle "
        "from each potentiometer, tendons taken as inextensible, against the encoder.",
    ),
    "figure-3": (
        "series-2",
        "Series 2: 2 N against 6 N, k = 806 N/m. Inextensible estimate, simulation from "
        "the measured forces alone, and Kalman filters; below, the errors of all but the first "
        f"with the {COVERED_TEXT} band of adaptive. The link rests afterwards, up to 8 s.",
    ),
    "figure-4": ("series-2-medium", "Series 2 at higher tension: 3 N against 9 N."),
    "figure-5": ("series-2-high", "Series 2 at the highest tension: 4 N against 12 N."),
}
"""Name of a figure → its scenario and its caption; the paper does not print the higher weights of
its figures 4 and 5.
"""

FILTERS = {"ekf-2008": 1, "ekf": 2, "adaptive": 0, "simulation": 4, "inextensible": 3}
"""Estimate in the figures of Series 2 → index of its colour and dash."""

NAMES = {"simulation": "simulation alone", "ekf-2008": "2008 filter", "ekf": "ekf, exact noise"}
"""Estimator → its label in figures, where that is not its own name."""

AFTER = 0.4
"""Time that the figures show after the link has come to rest [s]. Source: layout."""


def end_of_motion(shown: PlantRuns) -> float:
    """Return the time at which the figures of some runs end [s]: `AFTER` the link has come to rest
    in all.
    """
    ends = []
    for run in shown:
        theta = run.log.truth["theta"]
        moving = np.abs(theta - theta[-1]) > np.deg2rad(0.1)
        ends.append(run.log.time[moving].max(initial=0.0))
    return float(min(max(ends) + AFTER, shown[0].log.time[-1]))


def draw_figure(name: str, runs: Runs) -> Figure:
    """Return one of `FIGURES`: the plant with the friction of Table 1 beside that with more.

    Curves are of the first seed.
    """
    series, _ = FIGURES[name]
    shown = [_of(of_plant, series)[0] for of_plant in runs.values()]
    n = len(shown)
    layout = {"sharex": True, "sharey": "row", "height_ratios": [1.6, 1]}
    with figure(2, n, (7.2, 5.2), **layout) as (drawing, axes):
        for top, bottom, run in zip(axes[:n], axes[n:], shown):
            readings = np.rad2deg(run.log.channels["encoder"])
            style = {"color": SOFT, "linewidth": 2.2, "drawstyle": "steps-post"}
            top.plot(run.log.time, readings, label="encoder (1°)", **style)
            top.plot(run.log.time, np.rad2deg(run.log.truth["theta"]), label="truth", **TRUTH)
            if name == "figure-2":
                _draw_potentiometers(top, bottom, run)
            else:
                _draw_filters(top, bottom, run)
            top.set_title(f"plant with {run.plant}", fontsize=9, loc="left")
            bottom.axhline(0.0, color=BLACK, linewidth=0.6)
            bottom.set_xlabel("time [s]")
        if name != "figure-2":
            axes[0].set_xlim(0.7, end_of_motion(shown))
        axes[0].set_ylabel("link angle θ [°]")
        axes[n].set_ylabel("error [°]")
        legend = axes[0].get_legend_handles_labels()
        drawing.legend(*legend, loc="outside lower center", ncols=n + 2, fontsize=8)
    return drawing


def _draw_potentiometers(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    truth = np.rad2deg(run.log.truth["theta"])
    for i, (side, error) in enumerate(zip(SIDES, np.rad2deg(potentiometer_errors(run)))):
        style = {"linewidth": 1.2, **curve_style(i)}
        top.plot(run.log.time, truth + error, label=f"from {side} potentiometer", **style)
        bottom.plot(run.log.time, error, **style)


def _draw_filters(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    """Draw estimates, their errors but that of inextensible, and the band of adaptive about
    zero.
    """
    for name, index in FILTERS.items():
        estimate = run.estimates[name]
        style = curve_style(index)
        theta = np.rad2deg(estimate.theta)
        top.plot(run.log.time, theta, linewidth=1.2, label=NAMES.get(name, name), **style)
        if name != "inextensible":
            error = np.rad2deg(estimate.errors())
            bottom.plot(run.log.time, error, linewidth=1.1, **style)
    band = np.rad2deg(BAND * run.estimates["adaptive"].theta_std)
    style = {"color": band_colour(), "linewidth": 0}
    bottom.fill_between(run.log.time, -band, band, **style)
    top.fill_between([], [], [], label=f"{COVERED_TEXT} band of adaptive", **style)


ESTIMATES = ("inextensible", "simulation", "ekf-2008", "observed friction", "ekf", "adaptive")
"""Estimates in the table of errors."""

FILES = (
    *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")),
    "results.json",
    "index.html",
)
"""Names of the files that `reproduce` writes."""

INTRODUCTION = (
    "Proximal measurement of a tendon-driven rotating link, Canadian Conference on Electrical and "
    "Computer Engineering (CCECE), 2008, IEEE 978-1-4244-1643-1/08. A link is turned by two "
    "opposed nylon tendons; potentiometers and load cells at their far ends must tell its angle. "
    "Here the paper's tests are simulated again, on two plants. One has the friction of Table 1, "
    "which cannot produce the errors that the paper shows. The other has that with which most of "
    "the paper's statements hold. Every filter knows Table 1 only. The scenario files say what is "
    "assumed where the paper prints nothing."
)
"""Text at the top of the page."""

NOTE = (
    f"RMS over all samples of {len(SEEDS)} seeds of the sensors' errors; bold is the smallest of a "
    "row. ekf is the filter of 2008 with the noise of the sensors as the simulation has it, "
    "observed friction that filter with the friction of the second plant."
)
"""Text below the table of errors."""


def steps() -> int:
    """Return how often `reproduce` calls its `advance`."""
    return len(TESTS) + len(FIGURES)


def reproduce(out: Path, advance: Callable[[], None]) -> tuple[Claim, ...]:
    """Simulate and filter the paper's two series, and write the figures, ``results.json`` and
    ``index.html``.

    Return the paper's statements C1 to C12 with their measures.

    Args:
        out: the folder, which is made where it does not exist.
        advance: called after each test and after each figure.

    Raises:
        OutputError: the folder or a file cannot be written.
    """
    check_outputs([Path(out) / name for name in FILES], makes_folder=True)
    folder = make_folder(out)
    runs: Runs = {}
    for simulated, scenario in TESTS:
        runs.setdefault(simulated.name, []).extend(run_series(scenario, simulated))
        advance()
    by_plant = {name: measured(of_plant) for name, of_plant in runs.items()}
    claims = tuple(
        Claim(statement, {name: values[statement.key] for name, values in by_plant.items()})
        for statement in statements()
    )
    pictures = list[str]()
    files = dict[Path, bytes | str]()
    for name, (_, caption) in FIGURES.items():
        drawing = draw_figure(name, runs)
        for path in (folder / f"{name}.png", folder / f"{name}.svg"):
            files[path] = figure_bytes(drawing, path)
        titled = f"{name.replace('-', ' ').capitalize()}. {caption}"
        pictures.append(picture(svg_of(drawing, caption), titled))
        advance()
    errors: Errors = {
        plant: {
            series: {name: rms(of_plant, series, name) for name in ESTIMATES} for series in SERIES_2
        }
        for plant, of_plant in runs.items()
    }
    text = json.dumps(results(claims, errors), indent=2, ensure_ascii=False)
    files[folder / "results.json"] = text + "\n"
    files[folder / "index.html"] = _page(claims, errors, pictures)
    write_together(files)
    return claims


Errors = dict[str, dict[str, dict[str, float]]]
"""Name of a plant → scenario → estimate → RMS error [°]."""


def results(claims: Sequence[Claim], errors: Errors) -> dict[str, object]:
    """Return the content of `results.json`: for C1 to C12 their measures and group, and the errors
    of all estimates.
    """
    content: dict[str, object] = {
        claim.statement.key: {
            "statement": claim.statement.text,
            "group": claim.group,
            "threshold": claim.statement.why,
            "measures": [
                {
                    "measure": measure.text,
                    "least": measure.least,
                    "most": measure.most,
                    "values": {plant: values[i] for plant, values in claim.values.items()},
                    "holds": {
                        plant: measure.margin(values[i]) >= 0.0
                        for plant, values in claim.values.items()
                    },
                }
                for i, measure in enumerate(claim.statement.measures)
            ],
        }
        for claim in claims
    }
    return content | {"rms_error_deg": errors, "seeds": list(SEEDS)}


def _page(claims: Sequence[Claim], errors: Errors, pictures: Sequence[str]) -> str:
    held = sum(claim.holds(PLANTS[1].name) for claim in claims)
    rig = rig_svg(load_rig("paper-2008-printed"))
    parts = [
        picture(rig, "The rig, with the numbers of Table 1."),
        heading("Figures 2 to 5, simulated"),
        *pictures,
        heading(f"{held} of {len(claims)} statements hold on the plant with more friction"),
        paragraph(
            "The thresholds were written down before the first run and have not been changed since."
        ),
    ]
    for group in GROUPS:
        chosen = [claim for claim in claims if claim.group == group]
        if chosen:
            parts.append(heading(f"{group.capitalize()}: {len(chosen)} of {len(claims)}", 3))
            parts.append(_claims_table(chosen))
    parts += [heading("RMS errors in Series 2"), _errors_table(errors), paragraph(NOTE)]
    return page("The tests of a paper of 2008", INTRODUCTION, parts)


def _errors_table(errors: Errors) -> str:
    rows = []
    for plant, by_series in errors.items():
        for series, by_name in by_series.items():
            values = by_name.values()
            cells = [
                Html(f"<b>{value:.2f}</b>") if value == min(values) else f"{value:.2f}"
                for value in values
            ]
            rows.append([plant, series, *cells])
    columns = ["plant", "scenario", *(f"{name} [°]" for name in ESTIMATES)]
    return html_table(columns, rows, range(2, len(columns)))


def _claims_table(claims: Sequence[Claim]) -> str:
    rows = list[list[str]]()
    for claim in claims:
        statement = claim.statement
        first = Html(
            f"{escape(statement.text)}<br><span class='why'>{escape(statement.reason)}</span>"
        )
        for i, measure in enumerate(statement.measures):
            cells = []
            for values in claim.values.values():
                holds = measure.margin(values[i]) >= 0.0
                cells.append(verdict(f"{values[i]:.2f} {'✓' if holds else '✗'}", holds))
            bound = f"≥ {measure.least:g}" if measure.least is not None else f"≤ {measure.most:g}"
            rows.append([first if i == 0 else "", measure.text, bound, *cells])
    columns = ["statement, and why it stands here", "measure", "threshold"]
    return html_table([*columns, *(plant.name for plant in PLANTS)], rows, values=(2, 3, 4))

"""The 2008 paper's two test series, simulated on a plant and filtered with the parameters of the
paper's Table 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product

import numpy as np

from distal.estimators import KernelEstimator, make_estimator
from distal.estimators.paper_2008 import FullStateFilter, Noise, paper_noise
from distal.logs import Log
from distal.model import Mechanism
from distal.results import Estimate
from distal.rig import Rig, load_rig
from distal.run import estimate
from distal.simulation import Scenario, load_scenario, scenario_rig
from distal.simulation.simulate import motions_of, prepare, sampled

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
        return load_scenario(series).model_copy(update={"plant": dict(self.values)})


def observed_values() -> dict[str, object]:
    """Return path → value of the friction by which the shipped rig `paper-2008-observed` differs
    from Table 1.
    """
    rig = load_rig("paper-2008-observed")
    axle = rig.joints[0].friction
    assert axle is not None
    values: dict[str, object] = {
        "joints.0.friction.preload": axle.preload.value,
        "joints.0.friction.exponent": axle.exponent.value,
        "joints.0.friction.reference": axle.reference,
    }
    for i, drive in enumerate(rig.drives):
        assert drive.friction is not None
        values[f"drives.{i}.friction.constant"] = drive.friction.constant.value
        values[f"drives.{i}.friction.load"] = drive.friction.load.value
    return values


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
        seed: seed of the sensors' errors.
        rig: the rig that the filters know.
        log: the simulated log.
        estimates: name of an estimator or of a variant → its estimate.
    """

    series: str
    plant: str
    seed: int
    rig: Rig
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
        runs.append(SeriesRun(series, plant.name, seed, rig, log, estimates))
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


def all_runs(advance: Callable[[], None]) -> Iterator[SeriesRun]:
    """Yield all runs of the reproduction; `advance` is called after each of its `TESTS`."""
    for plant, series in TESTS:
        yield from run_series(series, plant)
        advance()

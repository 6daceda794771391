"""The 2008 paper's two test series, simulated and filtered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from distal.estimators import FullStateFilter, Noise, paper_noise
from distal.logs import Log
from distal.results import Estimate
from distal.rig import Rig
from distal.run import estimate
from distal.simulation import Scenario, load_scenario, scenario_rig, simulate

SERIES_1 = ("series-1-soft", "series-1")
SERIES_2 = ("series-2", "series-2-medium", "series-2-high")
PLANTS = ("as printed", "as observed")
SEEDS = (0, 1, 2, 3, 4)

OBSERVED: dict[str, object] = {
    "drives.0.friction.load": 0.1,
    "drives.1.friction.load": 0.1,
    "joints.0.friction.exponent": 1.5,
    "joints.0.friction.reference": "12.9 N",
}
"""What the plant "as observed" has beyond Table 1: slider friction 0.1 · T, axle friction that outgrows the load."""


@dataclass(frozen=True)
class Run:
    """One simulated test, and what each estimator made of it; all filters know Table 1 only.

    Args:
        series: name of the scenario.
        plant: ``"as printed"`` or ``"as observed"``.
        seed: of the sensors' errors.
        rig: what the filters know.
        log: the sensors' values and the truth.
        estimates: by name.
    """

    series: str
    plant: str
    seed: int
    rig: Rig
    log: Log
    estimates: dict[str, Estimate]


def plant_scenario(series: str, plant: str, **plant_values: object) -> Scenario:
    """Return a shipped scenario on a plant "as printed" or "as observed".

    Args:
        series: name of the scenario.
        plant: one of `PLANTS`.
        plant_values: further values of the plant, with ``__`` for each dot of the path.
    """
    values = dict(OBSERVED) if plant == "as observed" else {}
    values.update({name.replace("__", "."): value for name, value in plant_values.items()})
    return load_scenario(series).model_copy(update={"plant": values})


def free_simulation(rig: Rig) -> FullStateFilter:
    """Return the model driven by the measured forces alone: a filter that is sure of itself and learns nothing."""
    known = paper_noise(rig)
    still = Noise(
        np.zeros_like(known.inputs), np.zeros_like(known.process), known.measurements, np.zeros_like(known.initial)
    )
    return FullStateFilter("simulation", rig, still)


def hung_weights(log: Log, scenario: Scenario) -> Log:
    """Return the log with the hung weights in place of the load cells' readings.

    Args:
        log: of the scenario.
        scenario: what hangs on each drive.
    """
    channels = dict(log.channels)
    for sensor, drive in (("u1", "left"), ("u2", "right")):
        weight = scenario.drives[drive].weight
        if weight is not None:
            channels[sensor] = weight.at(log.time)
    return replace(log, channels=channels)


def observed_rig(rig: Rig) -> Rig:
    """Return the rig with the observed friction, for a filter that knows it."""
    return rig.with_values(OBSERVED)


def run_series(series: str, plant: str, seed: int) -> Run:
    """Simulate one test and run its estimators.

    Args:
        series: one of `SERIES_1` or `SERIES_2`.
        plant: one of `PLANTS`.
        seed: of the sensors' errors.
    """
    scenario = plant_scenario(series, plant)
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario, seed)
    estimates = {"inextensible": estimate(log, rig, "inextensible")}
    if series in SERIES_1:
        ideal = plant_scenario(series, plant, sensors__x1__linearity=0.0, sensors__x2__linearity=0.0)
        estimates["without linearity"] = estimate(simulate(rig, ideal, seed), rig, "inextensible")
        return Run(series, plant, seed, rig, log, estimates)
    estimates["adaptive"] = estimate(log, rig, "adaptive")
    estimates["ekf-2008"] = estimate(log, rig, "ekf-2008", passes=2)
    estimates["ekf"] = estimate(log, rig, "ekf")
    estimates["simulation"] = estimate(log, rig, free_simulation(rig))
    if series == "series-2":
        better = plant_scenario(series, plant, sensors__u1__noise="0.03 N", sensors__u2__noise="0.03 N")
        estimates["hung weights"] = estimate(hung_weights(log, scenario), rig, "ekf-2008", passes=2)
        estimates["better cells"] = estimate(simulate(rig, better, seed), rig, "ekf-2008", passes=2)
        estimates["observed friction"] = estimate(log, observed_rig(rig), "ekf-2008", passes=2)
        for name, (q, r) in READINGS.items():
            reading = FullStateFilter("ekf-2008", rig, paper_noise(rig, q=q, r=r))
            estimates[f"reading {name}"] = estimate(log, rig, reading)
    return Run(series, plant, seed, rig, log, estimates)


READINGS = {
    "Q and R in SI": (1e-3, 1e-3),
    "R in mm²": (1e-3, 1e-9),
    "Q and R both a thousandth of that": (1e-6, 1e-6),
    "Q and R both in mm²": (1e-9, 1e-9),
}
"""Readings of "Q = R = 0.001": (q, r) in SI."""


def all_runs(advance: Callable[[], None] = lambda: None) -> Iterator[Run]:
    """Yield every run of the reproduction; `advance` is called after each."""
    for plant in PLANTS:
        for series in (*SERIES_1, *SERIES_2):
            for seed in SEEDS:
                yield run_series(series, plant, seed)
                advance()


def run_count() -> int:
    """Return how many runs `all_runs` yields."""
    return len(PLANTS) * (len(SERIES_1) + len(SERIES_2)) * len(SEEDS)

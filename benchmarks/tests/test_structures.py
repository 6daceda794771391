"""Rigs that differ in numbers alone share their kernels: the same structure is the same C."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.structures import functions_of, rigs_like
from distal import load_rig
from distal.estimators import AdaptiveFilter, StateKind
from distal.estimators.adaptive import KINDS, Kind, State
from distal.kernels import c_source, structure_of
from distal.model import Mechanism
from distal.rig import shipped_rigs

DRAWS = 20


FEW = ("paper-2008-observed", "capstan-joint", "finger-2n")
some_rigs = pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in FEW else [pytest.mark.more])
        for name in shipped_rigs()
    ],
)


@some_rigs
def test_numbers_are_no_structure(name: str) -> None:
    """Twenty sets of numbers have one kernel of each kind, or two filters with other sub-steps."""
    rigs, kernels = rigs_like(name), dict[str, set[str]]()
    others = dict[str, set[str]]()
    for _ in range(DRAWS):
        for kind, (structure, _) in functions_of(next(rigs)).items():
            facts = repr([fact for fact in structure.facts if fact[0] != "sub steps"])
            kernels.setdefault(kind, set()).add(structure.key)
            others.setdefault(kind, set()).add(facts)
    assert {kind: len(found) for kind, found in others.items()} == dict.fromkeys(others, 1)
    assert max(map(len, kernels.values())) <= 2


def test_a_term_that_comes_is_another_structure() -> None:
    """A part, a term or a sub-step more is another kernel."""
    rig = load_rig("capstan-joint")
    changes: list[dict[str, object]] = [
        {"joints.0.damping": {"value": 0.0}},
        {"sensors.0.lag": "20 ms"},
        {"sensors.*.rate": "2 Hz"},
        {"joints.0.external_torque.std": 0.1},
        {"tendons.*.stiffness.drift": 0.0},
    ]
    keys = {AdaptiveFilter(rig.with_values(each), False).structure.key for each in ({}, *changes)}
    assert len(keys) == len(changes) + 1


@some_rigs
def test_the_same_structure_is_the_same_c(name: str) -> None:
    """No number of the rig is written into a kernel."""
    rigs = rigs_like(name, 2)
    one = functions_of(next(rigs))
    others = (functions_of(rig) for rig in rigs)
    other = next(found for found in others if found["filter"][0] == one["filter"][0])
    for kind, (_, make) in one.items():
        assert c_source(make()) == c_source(other[kind][1]()), kind


def harness(size: float) -> Kind:
    """Return a kind of state: a torque whose factor is written into the kernel."""
    torque = State(
        "harness", StateKind.OTHER, "", 1.0, 0.0, to=("torque", 0), times=lambda reading: size
    )
    return lambda context: [torque]


def test_states_of_others_have_kernels_of_their_own() -> None:
    """Nothing says what of them is a number, or when their code changes."""
    rig = load_rig("capstan-joint")
    angles = []
    for size in (0.0, 0.05):
        estimator = AdaptiveFilter(rig, False, kinds=(*KINDS, harness(size)))
        assert estimator.structure is None
        sample = np.zeros(len(estimator.channels))
        belief = estimator.initial(0.0, sample)
        means, *_ = estimator.scan(belief, np.array([estimator.interval]), sample[None])
        angles.append(means[0, 0])
    assert angles[0] != angles[1]


def test_a_constant_of_zero_is_another_structure_than_one_of_one() -> None:
    """A sheath's `let_out` of exactly 0 or 1 is no input; both have the same inputs."""
    path = {"friction": {"value": 0.1, "std": 0.03}, "wrap": 1.5, "nodes": 2}
    mechanisms = [
        Mechanism(load_rig("capstan-joint").with_values({"tendons.1.path": {**path, "let_out": x}}))
        for x in (0.0, 1.0)
    ]
    assert mechanisms[0].parameters.names == mechanisms[1].parameters.names
    keys = {structure_of("plant", mechanism).key for mechanism in mechanisms}
    assert len(keys) == 2

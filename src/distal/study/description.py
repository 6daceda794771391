"""Studies: what is asked of a rig before it is built, read from TOML."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from distal.errors import DistalError, StudyError, did_you_mean
from distal.estimators import DEFAULT, ESTIMATORS
from distal.rig import (
    Description,
    In,
    Rig,
    description_path,
    description_text,
    load_rig,
    parse_toml,
    shipped_in,
    validated,
)
from distal.simulation import Scenario, load_scenario
from distal.simulation.simulate import prepare

Share = Annotated[float, In("", "positive"), Field(le=1.0)]


class Requirement(Description):
    """What is asked of a rig as built."""

    joint: str = Field(min_length=1)
    within: Annotated[float, In("rad", "positive")] = Field(
        description="largest error of the estimate"
    )
    time: Share = Field(0.95, description="share of the time for which it holds")
    rigs: Share = Field(0.95, description="share of the rigs as built for which it holds")


class Study(Description):
    """A rig, what is done to it, what varies, and what is required."""

    rig: str = Field(min_length=1, description="a shipped rig, or a path from this file")
    name: str = Field("", description="title of the answer")
    scenarios: tuple[str, ...] = Field(min_length=1, description="shipped scenarios, or paths")
    duration: Annotated[float, In("s", "positive")] | None = Field(
        None, description="of each run; the scenario's by default"
    )
    estimator: str = Field(DEFAULT, description="as of `distal estimate -e`")
    designs: int = Field(256, ge=1, description="how many")
    seeds: int = Field(3, ge=1, le=100_000, description="rigs as built of each design")
    draw: int = Field(1, ge=0, description="seed of all random numbers")
    set: dict[str, object] = Field(
        default_factory=dict,
        description="numbers of the rig for all designs, over those of scenarios",
    )
    vary: dict[str, object] = Field(
        default_factory=dict,
        description="path of a number as for `--set`, `sensors.NAME` or `estimator` → a list, or "
        "a table with from and to",
    )
    requirement: Requirement

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.estimator not in ESTIMATORS:
            raise ValueError(
                f"estimator: unknown '{self.estimator}'{did_you_mean(self.estimator, ESTIMATORS)}"
            )
        if len(set(self.scenarios)) < len(self.scenarios):
            raise ValueError("scenarios: one stands more than once; seeds give several runs of one")
        return self


@dataclass(frozen=True)
class Plan:
    """A study with its rig and scenarios loaded, to be sent to other computers; the rig has the
    values of the study's ``set``.
    """

    study: Study
    rig: Rig
    scenarios: tuple[Scenario, ...]

    @property
    def digest(self) -> str:
        """Hash of the study, its rig and its scenarios, 32 hexadecimal digits."""
        parts = [
            self.study.model_dump(),
            self.rig.model_dump(),
            [repr(scenario) for scenario in self.scenarios],
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True, default=repr).encode()).hexdigest()[
            :32
        ]

    @property
    def joint(self) -> int:
        """The index of the joint that the requirement names."""
        return self.rig.joint_names.index(self.study.requirement.joint)


def shipped_studies() -> tuple[str, ...]:
    """Return the names of the studies that come with distal."""
    return shipped_in("distal.study")


def load_study(name: str | Path) -> Plan:
    """Load a study with its rig and scenarios, by a shipped study's name (see `shipped_studies`) or
    from a TOML file.

    Raises:
        StudyError: the study is unknown, cannot be read, or its description is wrong.
        RigError: its rig is unknown or wrong.
        ScenarioError: one of its scenarios is unknown or wrong.
    """
    text = description_text(name, "distal.study", "study", StudyError)
    beside = description_path(name, "distal.study").parent
    return plan_of(parse_toml(text, str(name), StudyError), str(name), beside)


def plan_of(raw: Mapping[str, object], source: str = "study", beside: Path = Path()) -> Plan:
    """Check a raw study and load the rig and the scenarios that it names.

    Args:
        source: name of the study in messages.
        beside: folder to which its paths are relative; default the current one.

    Raises:
        StudyError: something is wrong; one line that says where, what came and what is allowed.
        RigError: its rig is unknown or wrong.
        ScenarioError: one of its scenarios is unknown or wrong.
    """
    study = validated(Study, raw, source, StudyError)

    def position(name: str) -> str | Path:
        return beside / name if name.endswith(".toml") else name

    rig = load_rig(position(study.rig))
    rig = rig.with_values(study.set) if study.set else rig
    joints = rig.joint_names
    if study.requirement.joint not in joints:
        name = study.requirement.joint
        raise StudyError(
            f"{source}: requirement.joint: the rig has no joint "
            f"'{name}'{did_you_mean(name, joints)}"
        )
    scenarios = [load_scenario(position(name)) for name in study.scenarios]
    if study.duration is not None:
        scenarios = [
            scenario.model_copy(update={"duration": study.duration}) for scenario in scenarios
        ]
    for name, scenario in zip(study.scenarios, scenarios):
        try:
            prepare(rig, scenario)
        except DistalError as problem:  # every run would fail for it
            raise StudyError(
                f"{source}: scenario '{name}' does not fit the rig '{study.rig}': {problem}"
            ) from None
    return Plan(study, rig, tuple(scenarios))

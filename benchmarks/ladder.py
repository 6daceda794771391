"""Wrong rigs beside a known truth: is the cause named? `python -m benchmarks.ladder SEED [PLANT
…]`.

Plants are the given joint and finger of `newcomer`, and others that share no code with the model
(`PLANTS`). Each number × 0.5, 0.67, 0.9, 1.1, 1.5 and 2, each sign, unit and zero, one at a time. A
step counts where the truth is inside the band for less than 85 % or the error is above twice the
right rig's. Named is a cause in words of the thing that was changed; gear, spool and moment arm of
a drive are one, as are stiffness and a force's scale. With `--blind` nothing is told of the truth:
a step is missed where "consistent" is said and its group is not among those that cannot be tested.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from tests.support.foreign_plants import finger_log as foreign_finger_log
from tests.support.foreign_plants import finger_rig as foreign_finger_rig
from tests.support.foreign_plants import hand_log as foreign_hand_log
from tests.support.foreign_plants import hand_rig as foreign_hand_rig
from tests.support.given_plants import log_of
from tests.support.hands_plants import bowden_log, bowden_rig, ropes_log, ropes_rig

from benchmarks.chains import simulated
from distal import Log, Rig, diagnose, estimate, load_rig, read_log
from distal.diagnosis import why_diverged
from distal.diagnosis.causes import COMPLIANCE, SCALE, ZERO
from distal.errors import DivergedError
from distal.logs import write_log
from distal.results import Estimate

FACTORS = (0.5, 0.67, 0.9, 1.1, 1.5, 2.0)
UNITS = {"rad": 57.3, "m": 1000.0, "N": 4.448, "N m": 1000.0}


@dataclass(frozen=True)
class Step:
    """One thing that is wrong: by overrides of the rig file, or a factor on a channel and what is
    added to it.
    """

    name: str
    causes: tuple[str, ...]
    overrides: tuple[str, ...] = ()
    channel: str = ""
    factor: float = 1.0
    added: float = 0.0
    swapped: tuple[str, str] | None = None


def steps(rig: Rig, factors: Sequence[float] = FACTORS) -> Iterator[Step]:
    """Yield the right rig, then all wrong ones, each with words of which one has to be in what is
    said of its cause.
    """
    yield Step("right", ())
    for sensor in rig.sensors:
        if sensor.measures in ("position", "force"):
            words: tuple[str, ...] = (
                (sensor.name,)
                if sensor.measures == "position"
                else (sensor.name, "stretched the tendons of " + sensor.of)
            )
            yield Step(f"sign of {sensor.name}", words, (f"sensors.{sensor.name}.sign=-1",))
            yield Step(
                f"unit of {sensor.name}", words, channel=sensor.name, factor=UNITS[sensor.si]
            )
            for key in ("gear", "torque_constant_motor"):
                if getattr(sensor, key, None) not in (None, 1.0):
                    yield from _scaled(
                        f"sensors.{sensor.name}.{key}", float(getattr(sensor, key)), words, factors
                    )
        if sensor.measures == "position":
            yield Step(
                f"zero of {sensor.name}",
                words,
                channel=sensor.name,
                added=0.35 if sensor.si == "rad" else 1.5e-3,
            )
    for tendon in rig.tendons:
        positions = tuple(
            sensor.name
            for sensor in rig.sensors
            if sensor.of == tendon.drive and sensor.measures == "position"
        )
        force = tuple(
            sensor.name
            for sensor in rig.sensors
            if sensor.of == tendon.drive and sensor.measures == "force"
        )
        yield from _scaled(
            f"tendons.{tendon.name}.stiffness", tendon.stiffness.value, force, factors
        )
        yield from _scaled(
            f"tendons.{tendon.name}.pretension",
            tendon.pretension.value,
            (*positions, *force),
            factors,
        )
        for meeting in tendon.meetings:
            path = meeting.path
            radius = getattr(meeting.shape, "radius", None)
            if radius is not None:
                joint = tendon.joints[int(path.split(".")[1])] if "." in path else tendon.joints[0]
                words = (
                    f"{tendon.drive} at {joint}",
                    *(positions if len(tendon.joints) == 1 else ()),
                )
                yield from _scaled(
                    f"tendons.{tendon.name}.{path}.radius", radius.value, words, factors
                )
    yield from _swaps(rig)
    yield from _frictions(rig)
    for drive in rig.drives:
        if drive.kind == "capstan":
            positions = tuple(
                sensor.name
                for sensor in rig.sensors
                if sensor.of == drive.name and sensor.measures == "position"
            )
            yield from _scaled(
                f"drives.{drive.name}.radius", drive.radius.value, positions, factors
            )


def _swaps(rig: Rig) -> Iterator[Step]:
    """Yield two columns of a kind that are exchanged, for each pair of neighbours."""
    for kind in ("position", "force"):
        sensors = rig.sensors_of(kind)
        for first, second in pairwise(sensors):
            names = (first.name, second.name)
            yield Step(f"swapped {' and '.join(names)}", ("swapped",), swapped=names)


def _frictions(rig: Rig) -> Iterator[Step]:
    """Yield wrong friction of joints and drives."""
    for kind in ("joints", "drives"):
        for part in getattr(rig, kind):
            friction = part.friction
            for key in ("coefficient", "constant", "load"):
                number = getattr(friction, key, None)
                if number is not None and number.value > 0.0:
                    path = f"{kind}.{part.name}.friction.{key}"
                    for factor in (0.33, 3.0):
                        words = ("friction of " + part.name, "friction")
                        yield Step(
                            f"{path} × {factor:g}", words, (f"{path}={number.value * factor:.9g}",)
                        )


def _scaled(
    path: str, value: float, causes: tuple[str, ...], factors: Sequence[float]
) -> Iterator[Step]:
    for factor in factors:
        yield Step(f"{path} × {factor:g}", causes, (f"{path}={value * factor:.9g}",))


PLANTS: dict[str, tuple[Callable[[int], Log], Callable[[], Rig]]] = {
    "bowden": (lambda seed: bowden_log(seed, "ramps"), bowden_rig),
    "ropes": (lambda seed: ropes_log(seed, "ramps"), ropes_rig),
    "foreign": (foreign_finger_log, foreign_finger_rig),
    "hand": (foreign_hand_log, foreign_hand_rig),
    "finger-2n": (
        lambda seed: simulated("finger-2n", "servo", seed),
        lambda: load_rig("finger-2n"),
    ),
    "finger-n-plus-1": (
        lambda seed: simulated("finger-n-plus-1", "servo", seed),
        lambda: load_rig("finger-n-plus-1"),
    ),
    "wrist": (
        lambda seed: simulated("wrist-instrument", "servo", seed),
        lambda: load_rig("wrist-instrument"),
    ),
}
"""Plants of other benchmarks: a log of a seed, and its right rig."""

GIVEN = ("joint", "finger")
"""Plants in `$DISTAL_DATA/newcomer`."""


def placed(name: str, seed: int, path: Path) -> Callable[[Sequence[str]], Rig]:
    """Write a log of a plant, and return its rig as a function of overrides."""
    if name in GIVEN:
        log_of(name, seed, path.parent)
        file = Path(os.environ["DISTAL_DATA"]) / "newcomer" / f"{name}.toml"
        return lambda overrides: load_rig(file, overrides)
    simulated_log, rig_of = PLANTS[name]
    right = rig_of()
    write_log(simulated_log(seed), right, path)
    return lambda overrides: right.with_values(
        {path: float(value) for path, _, value in (one.partition("=") for one in overrides)}
    )


def counted(
    seed: int, names: Sequence[str], factors: Sequence[float] = FACTORS
) -> Iterator[tuple[str, Step, Log, Rig, Estimate | None]]:
    """Yield each step that counts: name of the plant, step, log, rig, and what was estimated unless
    it diverged.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            path = Path(folder) / f"{name}.csv"
            rig_of = placed(name, seed, path)
            right = np.inf
            for step in steps(rig_of(()), factors):
                rig = rig_of(step.overrides)
                log = read_log(path, rig)
                if step.channel or step.swapped:
                    log = _changed(log, step)
                try:
                    result = estimate(log, rig)
                except DivergedError:
                    yield name, step, log, rig, None
                    continue
                right = result.rms_error() if step.name == "right" else right
                if step.name != "right" and (
                    result.inside_band() < 0.85 or result.rms_error() > 2 * right
                ):
                    yield name, step, log, rig, result


def judged(
    step: Step, log: Log, rig: Rig, result: Estimate | None, blind: bool
) -> tuple[bool, bool, str]:
    """Return whether the cause was named, whether "consistent" was said, and what was said."""
    if blind:
        log = replace(log, truth={})
    if result is None:
        findings, text = tuple(why_diverged(log, rig)), "diverged"
    else:
        said = diagnose(replace(result, truths=None) if blind else result, log, rig)
        findings, text = said.findings, said.text
    looks = [finding for finding in findings if finding.kind in ("looks like", "would explain")][:2]
    is_named = any(cause in finding.text for finding in looks for cause in step.causes)
    if blind:
        group = ZERO if step.added or "pretension" in step.name else SCALE
        if "stiffness" in step.name or any(
            s.name == step.channel and s.measures == "force" for s in rig.sensors
        ):
            group = COMPLIANCE
        looks += [finding for finding in findings if finding.kind == "cannot test"]
        is_named |= any(
            finding.kind == "cannot test" and group in finding.text for finding in findings
        )
    return (
        is_named,
        text.startswith("consistent"),
        "; ".join(finding.text for finding in looks) or text,
    )


def main() -> None:
    """Print each step that counts with what is said, and how many were named."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ladder", description=__doc__)
    parser.add_argument("seed", type=int)
    parser.add_argument(
        "plants",
        nargs="*",
        default=GIVEN,
        help=f"of {', '.join((*GIVEN, *PLANTS))}; default the given",
    )
    parser.add_argument("--blind", action="store_true", help="without the truth")
    parser.add_argument(
        "--factors", type=float, nargs="+", default=FACTORS, help="how wrong each number is"
    )
    given = parser.parse_args()
    verdicts = []
    for name, step, log, rig, result in counted(given.seed, given.plants, given.factors):
        is_named, consistent, said = judged(step, log, rig, result, given.blind)
        missed = consistent and not (given.blind and is_named)
        verdicts.append((is_named, missed))
        verdict = "MISSED" if missed else "named" if is_named else "other"
        score = (
            ""
            if result is None
            else f"{np.rad2deg(result.rms_error()):.2f}° {100 * result.inside_band():.0f} %"
        )
        print(f"{name:9} {step.name:42} {score:>14}  {verdict:7} {said[:150]}", flush=True)
    named, missed = np.sum(verdicts, axis=0)
    print(
        f"{len(verdicts)} steps count: {named} named ({100 * named / len(verdicts):.0f} %), "
        f"{missed} missed"
    )


def _changed(log: Log, step: Step) -> Log:
    if step.swapped is not None:
        first, second = step.swapped
        exchanged = {first: log.channels[second], second: log.channels[first]}
        return replace(log, channels={**log.channels, **exchanged})
    return replace(
        log,
        channels={
            **log.channels,
            step.channel: step.factor * log.channels[step.channel] + step.added,
        },
    )


if __name__ == "__main__":
    main()

"""What an exported filter puts out: angles of the joints and torques on them from outside, by the
names that C allows.
"""

from __future__ import annotations

import re

from distal.estimators import KernelEstimator, external_torques_of
from distal.rig import Rig, angle_names, std_name


def filled(template: str, values: dict[str, str]) -> str:
    """Return a template with ``$name$`` replaced; what is put in is not looked at again."""
    return re.sub(r"\$(\w+)\$", lambda m: values[m[1]], template)


def comment(text: str) -> str:
    """Return a text that may stand in a comment of C."""
    plain = "".join(c if c.isprintable() else " " for c in text)[:200]
    for ends, harmless in (("\\", "/"), ("??", "? ?"), ("*/", "* /"), ("/*", "/ *"), ("*/", "* /")):
        plain = plain.replace(ends, harmless)
    return " ".join(plain.split())


def angle_fields(rig: Rig) -> list[tuple[str, str]]:
    """Return the names of angle and standard deviation of each joint in an exported filter's
    output.

    ``angle`` and ``angle_std`` for one joint, else those of `angle_names`, with _ for what C does
    not allow in a name.
    """
    joints = rig.joint_names
    if len(joints) == 1:
        return [("angle", "angle_std")]
    names: list[str] = []
    for angle in angle_names(joints):
        plain = re.sub(r"[^A-Za-z0-9]", "_", angle)
        names.append(
            next(n for n in (plain, *(f"{plain}_{i}" for i in range(2, 10_000))) if n not in names)
        )
    return [(name, std_name(name)) for name in names]


def torque_fields(estimator: KernelEstimator) -> list[tuple[str, str]]:
    """Return the states that are torques from outside, and their names in an exported filter's
    output.
    """
    states = [estimator.state_names[i] for i in external_torques_of(estimator).values()]
    return [(state, re.sub(r"[^A-Za-z0-9]", "_", state)) for state in states]


def members(estimator: KernelEstimator, name: str) -> str:
    """Return the members of the output that are angles and torques from outside, with their
    standard deviations.
    """
    lines = []
    rig = estimator.rig
    for (angle, std), joint in zip(angle_fields(rig), rig.joints):
        which = "the joint" if len(rig.joints) == 1 else comment(joint.name)
        lines += [f"  {name}_real {angle}; /* of {which} [rad] */"]
        lines += [f"  {name}_real {std}; /* standard deviation of its error [rad] */"]
    for _, field in torque_fields(estimator):
        lines += [f"  {name}_real {field}; /* on the joint [N m] */"]
        lines += [f"  {name}_real {std_name(field)}; /* standard deviation of its error [N m] */"]
    return "\n".join(lines)


def outputs(estimator: KernelEstimator, n: int, stepped: bool = True) -> str:
    """Return the lines that fill these members from the `n` states; before the first sample no
    learned map has spoken.
    """
    fields = [(j, *pair) for j, pair in enumerate(angle_fields(estimator.rig))]
    fields += [
        (estimator.state_names.index(state), f, std_name(f))
        for state, f in torque_fields(estimator)
    ]
    lines = []
    report = estimator.report
    for at, field, std in fields:
        estimate = f"state->kernel_state[{at}]"
        variance = f"state->kernel_state[{n + at * (n + 1)}]"
        if stepped and at in report.states:  # a learned map speaks of it
            k = report.states.index(at)
            gain = f"y[{report.gains[k]}]"
            estimate = f"y[{report.values[k]}]"
            variance = f"{gain} * {gain} * {variance} + y[{report.variances[k]}]"
        lines += [f"    out->{field} = {estimate};", f"    out->{std} = root({variance});"]
    return "\n".join(lines)

"""Logs that another simulator made: the main job on input that nobody here simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from distal import estimate, load_rig, read_log

# bounds: what is measured (see docs/results/accuracy.md) rounded up by a quarter; worse is a
# regression
SERVO = {
    "adaptive": 0.35,
    "inextensible": 11.5,
    "elastic": 1.1,
}
HAND = {
    "adaptive": 5.5,
    "inextensible": 6.0,
    "elastic": 6.5,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", tuple(SERVO))  # no log of this rig before it
@pytest.mark.parametrize(("log", "bounds"), [("servo", SERVO), ("hand", HAND)])
def test_every_estimator_runs_on_the_mujoco_logs(
    data: Path, name: str, log: str, bounds: dict[str, float]
) -> None:
    folder = data / "mujoco_rig"
    rig = load_rig("pulley-antagonist")
    read = read_log(
        folder / f"mujoco_tension_{log}.csv", rig, folder / f"mujoco_tension_{log}.truth.csv"
    )
    result = estimate(read, rig, name)
    assert len(result) == 1200
    assert np.rad2deg(result.rms_error()) < bounds[name]


@pytest.mark.parametrize(
    ("friction", "bound"),
    [(0.15, 1.75), ({"value": 0.05, "std": 0.15}, 2.0)],
    ids=["given", "hardly known"],
)
def test_adaptive_follows_a_hand(data: Path, friction: object, bound: float) -> None:
    """The project's goals, with a torque that nobody measures and sheath friction given or hardly
    known.
    """
    folder = data / "mujoco_rig"
    values = {"drives.0.friction.load": friction, "drives.1.friction.load": friction}
    rig = load_rig("pulley-antagonist").with_values(
        {**values, "joints.0.external_torque.std": "0.1 N m"}
    )
    read = read_log(
        folder / "mujoco_tension_hand.csv", rig, folder / "mujoco_tension_hand.truth.csv"
    )
    result = estimate(read, rig, "adaptive")
    assert np.rad2deg(result.rms_error()) < bound
    assert result.inside_band() >= 0.88
    assert 1.96 * result.theta_std.mean() < 4.0 * result.rms_error()  # and not by width alone


CHAINS = {
    "finger-2n": ("finger2N", "0.04 N m", {"servo": 0.69, "step": 1.0, "contact": 0.83}),
    "finger-n-plus-1": ("finger_n1", "0.04 N m", {"servo": 0.29, "step": 0.52, "contact": 0.78}),
    "finger-underactuated": (
        "finger_under",
        "0.03 N m",
        {"servo": 0.52, "step": 1.77, "contact": 3.8},
    ),
    "wrist-instrument": (
        "wrist_instrument",
        "0.02 N m",
        {"servo": 0.24, "step": 0.41, "contact": 0.29},
    ),
}
"""Shipped rig → name of its logs, the torque that may occur in a contact, and bounds as above: mean
RMS of the joints.
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["servo", "step", "contact"])
@pytest.mark.parametrize("name", CHAINS)
def test_chains_of_others(data: Path, name: str, kind: str) -> None:
    """docs/results/chains.md has what is measured; the sum that one flexor tells, and the bands,
    are beside the mean.
    """
    stem, torque, bounds = CHAINS[name]
    rig, folder = load_rig(name), data / "finger"
    log = read_log(folder / f"{stem}_{kind}.csv", rig, folder / f"{stem}_{kind}.truth.csv")
    if kind == "contact":
        rig = rig.with_values({"joints.*.external_torque.std": torque})
    result = estimate(log, rig)
    assert result.truths is not None
    late = result.time >= 0.5
    errors = np.rad2deg(result.angles - result.truths)[late]
    inside = np.mean(np.abs(errors) <= 1.96 * np.rad2deg(result.angle_stds)[late])
    assert np.sqrt(np.mean(errors**2, axis=0)).mean() < bounds[kind]
    assert inside > (0.75 if (name, kind) == ("finger-underactuated", "step") else 0.9)
    if name == "finger-underactuated":
        assert np.sqrt(np.mean((errors @ [9.0, 7.0, 5.0] / 21.0) ** 2)) < 0.4

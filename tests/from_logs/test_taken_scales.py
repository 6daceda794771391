"""What needs a true force refuses a rig whose scales were taken, and says what settles them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import distal
from distal.cli.app import app
from distal.hands import Hand
from distal.hands.calibrate import calibrate
from distal.hands.power_on_routine import Routine
from distal.inverse import Inverse, LiveInverse
from distal.rig import Rig, edited_text, scales_in_words
from tests.hands.test_hand import Orca, sound_rig

TIME = np.linspace(0.0, 1.0, 50)


def taken(*scales: str) -> Rig:
    return distal.load_rig("finger-2n").model_copy(update={"taken": scales})


def hand_rig(*scales: str) -> Rig:
    return sound_rig().model_copy(update={"taken": scales})


def set_positions(rig: Rig, folder: Path) -> None:
    hand = Hand(Orca(), rig, compiled=False)
    for k in range(20):
        hand.update(0.01 * k)
    hand.set_joint_positions(dict.fromkeys(rig.joint_names, 0.1))


CALLS: dict[str, Callable[[Rig, Path], object]] = {
    "Inverse": lambda rig, folder: Inverse(rig),
    "LiveInverse with a tension": lambda rig, folder: LiveInverse(rig, least_tension="3 N"),
    "export_c": lambda rig, folder: distal.export_c(rig, folder / "c", command=True),
}


@pytest.mark.parametrize("scales", [("force",), ("length",), ("length", "force")])
@pytest.mark.parametrize("call", list(CALLS))
def test_commands_that_keep_tendons_taut_are_refused(
    call: str, scales: tuple[str, ...], tmp_path: Path
) -> None:
    with pytest.raises(distal.DistalError, match=r"needs a true tension.*settles it: one true"):
        CALLS[call](taken(*scales), tmp_path)
    assert not (tmp_path / "c").exists()


TORQUES: dict[str, Callable[[Rig, Path], object]] = {
    "a routine": lambda rig, folder: Routine(rig),
    "a calibration": lambda rig, folder: calibrate(folder / "log.csv", rig),
    "power_on of a hand": lambda rig, folder: Hand(Orca(), rig, compiled=False).power_on(),
    "positions of a hand": set_positions,
}


@pytest.mark.parametrize("scales", [("force",), ("length", "force")])
@pytest.mark.parametrize("call", list(TORQUES))
def test_what_limits_motors_by_torques_is_refused(
    call: str, scales: tuple[str, ...], tmp_path: Path
) -> None:
    with pytest.raises(distal.DistalError, match=r"needs a true (torque|tension)"):
        TORQUES[call](hand_rig(*scales), tmp_path)


@pytest.mark.parametrize(
    "asked",
    ["command desired.csv --rig rig.toml --out out", "export-c rig.toml --command --out out"],
)
def test_the_command_is_refused_and_nothing_is_written(
    asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text('taken = ["force"]\n' + edited_text("finger-2n"), encoding="utf-8")
    Path("desired.csv").write_text(
        "t,theta_mcp,theta_pip\n0,0.3,0.4\n1,0.4,0.5\n", encoding="utf-8"
    )
    done = CliRunner().invoke(app, asked.split())
    assert "needs a true t" in str(done.output) + str(done.exception)
    assert {path.name for path in tmp_path.iterdir()} == {"rig.toml", "desired.csv"}


def test_angles_do_not_need_a_scale() -> None:
    rig = taken("force")
    log = distal.simulate(rig, "finger", seed=1)
    assert np.isfinite(distal.estimate(log, rig, compiled=False).angles).all()
    assert "torque constant" in scales_in_words(rig)
    assert scales_in_words(taken()) == ""

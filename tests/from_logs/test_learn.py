"""`distal learn` and `distal rig from-logs` as a user runs them, on the logs that ship."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import distal
from distal.cli.app import app

LOGS = Path(__file__).parents[2] / "examples" / "finger_logs"
ROWS = 800


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    paths = []
    for k in range(3):
        lines = (LOGS / f"run_{k}.csv").read_text().splitlines()[: ROWS + 1]
        paths.append(folder / f"run {k}.csv")
        paths[-1].write_text("\n".join(lines) + "\n")
    return paths


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.output + str(done.exception or "")


def test_a_rig_file_that_goes_on(logs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "draft.toml"
    code, said = run("rig", "from-logs", *logs, "--out", out)
    assert code == 0, said
    assert "motor moves finger (+1.2" in said
    assert "mA, sure" in said
    assert re.search(r"Next: distal fit '.*run 0.csv'", said)
    rig = distal.load_rig(out)
    assert rig.taken == ("length", "force")
    assert "# not in the logs: friction of joints" in out.read_text()
    log = distal.read_log(logs[0], rig)
    assert distal.estimate(log, rig, compiled=False).rms_error() < 0.05
    for words in (("rig", "check", out), ("estimate", logs[0], "--rig", out, "--no-what-if")):
        code, said = run(*words)
        assert code == 0, said
        assert "the scale of length and force" in " ".join(said.split())
    code, said = run("rig", "from-logs", *logs, "--out", out)
    assert code != 0
    assert "exists already" in said


def test_overrules_by_names_without_units(logs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "draft.toml"
    options = ("--truth", "finger", "--drive", "motor=deg", "--ignore", "current")
    code, said = run("rig", "from-logs", *logs, "--out", out, *options)
    assert code == 0, said
    assert [sensor.measures for sensor in distal.load_rig(out).sensors] == ["position", "angle"]
    code, said = run("rig", "from-logs", *logs, "--out", tmp_path / "b.toml", "--truth", "fingr")
    assert code != 0
    assert "did you mean 'finger [deg]'" in said


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::distal.DistalWarning")
def test_learn_writes_what_it_says(logs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "finger.toml"
    code, said = run("learn", *logs, "--out", out)
    assert code == 0, said
    found = re.search(r"answer: on logs left out the joints are known to ±([\d.]+)°", said)
    assert found is not None
    assert 0.05 < float(found[1]) < 1.0
    rig = distal.load_rig(out)
    assert rig.taken == ("length", "force")
    log = distal.read_log(LOGS / "unseen.csv", rig)
    result = distal.estimate(log, rig)
    assert result.rms_error() < 0.01
    assert result.inside_band() > 0.8


@pytest.mark.filterwarnings("ignore::distal.DistalWarning")
@pytest.mark.parametrize(
    ("ends", "stays"), [(KeyboardInterrupt(), True), (distal.errors.FitError("no motion"), False)]
)
def test_what_is_known_before_the_fit_is_a_file(
    ends: BaseException,
    stays: bool,
    logs: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It can be used at once, and stays where the user ends the fit; of logs that cannot be fitted
    there is none.
    """
    out = tmp_path / "finger.toml"
    first = list[distal.Rig]()

    def fit(*_: object, **__: object) -> None:
        first.append(distal.load_rig(out))
        raise ends

    monkeypatch.setattr("distal.fitting.fit", fit)
    run("learn", *logs, "--out", out)
    assert out.exists() == stays
    result = distal.estimate(distal.read_log(LOGS / "unseen.csv", first[0]), first[0])
    assert result.inside_band() > 0.9

"""A simulated log has its rig beside it, and what its scenario changed in that."""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import load_rig, load_scenario, scenario_rig
from distal.errors import RigError
from distal.simulation import rig_beside, rig_of_logs, text_beside

SERIES = ("series-2", "series-2-high")


def simulated(folder: Path, name: str, rig: str | None = None) -> Path:
    """Write the file beside a log of a scenario."""
    scenario = load_scenario(name)
    log = folder / f"{name}.csv"
    rig_beside(log).write_text(text_beside(rig or scenario.rig, scenario.set))
    return log


def initial(rig: object) -> float:
    return rig.joints[0].initial.value  # type: ignore[attr-defined, no-any-return]


def test_the_rig_beside_is_the_scenarios(tmp_path: Path) -> None:
    log = simulated(tmp_path, "series-2")
    rig, changed = rig_of_logs([log], None)
    assert rig == scenario_rig(load_scenario("series-2"))
    assert changed == tuple(load_scenario("series-2").set)
    later, _ = rig_of_logs([log], None, ["joints.link.initial=0.1"])
    assert initial(later) == 0.1


def test_a_shipped_rig_of_the_same_parts_gets_the_changes_and_a_file_does_not(
    tmp_path: Path,
) -> None:
    log = simulated(tmp_path, "series-2")
    before = scenario_rig(load_scenario("series-2"))
    other, changed = rig_of_logs([log], "paper-2008-observed")
    assert changed
    assert initial(other) == initial(before) != initial(load_rig("paper-2008-observed"))
    assert rig_of_logs([log], "capstan-joint") == (load_rig("capstan-joint"), ())
    mine = tmp_path / "mine.toml"
    mine.write_text(
        (Path(load_rig.__code__.co_filename).parent / "library")
        .joinpath("paper-2008-printed.toml")
        .read_text()
    )
    unchanged, none = rig_of_logs([log], str(mine))
    assert none == ()
    assert initial(unchanged) == initial(load_rig("paper-2008-printed"))


def test_the_rig_of_a_file_is_found_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = Path(load_rig.__code__.co_filename).parent / "library"
    (tmp_path / "mine.toml").write_text((library / "paper-2008-printed.toml").read_text())
    monkeypatch.chdir(tmp_path)
    log = simulated(tmp_path, "series-2", "mine.toml")
    monkeypatch.chdir(library)
    assert initial(rig_of_logs([log], None)[0]) == initial(scenario_rig(load_scenario("series-2")))


def test_which_rig_is_asked_where_none_is_beside(tmp_path: Path) -> None:
    logs = [simulated(tmp_path, name) for name in SERIES]
    with pytest.raises(RigError, match="different rigs or scenarios"):
        rig_of_logs(logs, None)
    assert rig_of_logs(logs, "paper-2008-printed") == (load_rig("paper-2008-printed"), ())
    with pytest.raises(RigError, match=r"--rig takes .* only a log that distal simulate wrote"):
        rig_of_logs([tmp_path / "mine.csv"], None)
    rig_beside(logs[0]).write_text("rig = 3")
    with pytest.raises(RigError, match="rig is a name or path"):
        rig_of_logs(logs[:1], None)

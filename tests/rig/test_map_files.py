"""The numbers of learned maps, in a file beside the rig file."""

from __future__ import annotations

import re
import shutil
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from distal import Rig, load_rig
from distal.errors import OutputError, RigError
from distal.fitting.fit import write_fitted
from distal.rig import LearnedMap, MapArrays, arrays_file, build_rig
from tests.learned_maps import drawn_map, with_drawn


@pytest.fixture
def rig() -> Rig:
    return with_drawn(load_rig("capstan-joint"))


@pytest.fixture
def path(rig: Rig, tmp_path: Path) -> Path:
    file = tmp_path / "own.toml"
    write_fitted(file, rig, rig.bare(), {}, "", None)
    return file


def test_it_reads_as_the_same_rig(rig: Rig, path: Path) -> None:
    assert load_rig(path) == rig
    assert hash(load_rig(path)) == hash(rig)
    assert "covariance" not in path.read_text()
    moved = path.parent / "folder"
    moved.mkdir()
    for file in (path, arrays_file(path)):
        shutil.copy(file, moved)
    assert load_rig(moved / "own.toml") == rig


def test_it_is_copied_and_described_with_its_numbers(rig: Rig) -> None:
    assert build_rig(rig.model_dump(), "dumped") == rig
    assert rig.bare().map is None
    other = rig.with_map(filter=[drawn_map(seed=9)])
    assert other != rig
    assert "learned maps: readings, filter" in repr(rig)


def test_another_file_is_named_in_a_line(path: Path, rig: Rig) -> None:
    numbers, text = arrays_file(path), path.read_text()
    path.write_text(text.replace('"own.map.npz"', '"../own.map.npz"'))
    said = r"map\.file is the name of an \.npz file beside it; '\.\./own\.map\.npz'"
    with pytest.raises(RigError, match=said):
        load_rig(path)
    path.write_text(text)
    write_fitted(path.parent / "other.toml", with_drawn(rig.bare(), 3), rig.bare(), {}, "", None)
    for content in (b"nothing", (path.parent / "other.map.npz").read_bytes()):
        numbers.write_bytes(content)
        said = r"own\.map\.npz is not the file that was written with this rig"
        with pytest.raises(RigError, match=said):
            load_rig(path)
    numbers.unlink()
    with pytest.raises(RigError, match=r"needs the file own\.map\.npz beside the rig file"):
        load_rig(path)


def test_a_pickle_is_never_opened(path: Path) -> None:
    """An array of objects is refused, though its SHA-256 is the one that the rig file names."""
    numbers = arrays_file(path)
    np.savez(numbers, **{"readings.0.mean": np.array([{}], dtype=object)})
    digest = sha256(numbers.read_bytes()).hexdigest()
    path.write_text(re.sub('sha256 = ".*"', f'sha256 = "{digest}"', path.read_text()))
    with pytest.raises(RigError, match=r"own\.map\.npz cannot be read"):
        load_rig(path)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("mean", np.zeros((1, 3)), r"mean must be an array of \(1, 30\); one of \(1, 3\) came"),
        ("scale", np.zeros(3), "every scale must be positive"),
        ("noise", np.array([np.nan]), "noise has a value that is not finite"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(name: str, value: np.ndarray, words: str) -> None:
    learned = drawn_map()
    arrays = {**learned.arrays.by_name, name: value}
    with pytest.raises(ValueError, match=words):
        LearnedMap.model_validate({**learned.model_dump(), "arrays": MapArrays(**arrays)})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"channels": ("motor_angle", "gone")}, "no sensor is called 'gone'"),
        ({"joints": ("jow",)}, r"filter: each joint is needed once \(jaw\)"),
    ],
)
def test_a_map_of_another_rig_is_refused(change: dict[str, object], words: str, rig: Rig) -> None:
    learned = drawn_map().model_copy(update=change)
    dumped = rig.with_map(filter=[learned]).model_dump()
    with pytest.raises(RigError, match=words):
        build_rig(dumped, "another")


def test_where_one_of_both_cannot_be_written_both_stay(path: Path, rig: Rig) -> None:
    before = [file.read_bytes() for file in (path, arrays_file(path))]
    path.chmod(0o444)
    arrays_file(path).unlink()
    arrays_file(path).mkdir()
    with pytest.raises(OutputError):
        write_fitted(path, with_drawn(rig.bare(), 5), rig.bare(), {}, "", None)
    assert path.read_bytes() == before[0]

"""What was learned from logs: maps, and what forces are like while nothing touches the joints. The
tables `[map]` and `[left_out]` of a rig file describe them; the numbers of maps are in a file
beside it.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from functools import cached_property
from math import degrees
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from distal.arrays import Floats
from distal.confidence import COVERED_TEXT
from distal.errors import RigError
from distal.rig.values_with_stds import Description, Raw
from distal.units import rounded

Row = tuple[float, ...]

HALF_WIDTHS = (0.03, 0.1, 0.3, 1.0)
"""Half-widths of the plays of each reading, in its standard deviations [1]: a sum of plays is a
Prandtl–Ishlinskii operator. Source: benchmark (python -m benchmarks.one_map).
"""

IN_RADIAL = 1
"""Index of the half-width whose slips enter the radial functions. Source: benchmark (python -m
benchmarks.one_map).
"""

TIME_CONSTANTS = (0.05, 0.2, 0.8)
"""Time constants of the lags of each reading [s]. Source: benchmark (python -m
benchmarks.one_map).
"""

KINDS = ("readings", "filter", "efforts")
"""The kinds of maps in the table `[map]`."""


WIDER = 0.1
"""Share of the range of a reading in the logs by which it may go beyond each end [1]. Source:
judgement.
"""


class MapArrays:
    """The arrays of a map by name, read-only; equal where all their bytes are.

    Args:
        arrays: name → array, of which copies are kept.
    """

    def __init__(self, **arrays: Floats) -> None:
        kept = {name: np.array(array, dtype=np.float64) for name, array in arrays.items()}
        for array in kept.values():
            array.flags.writeable = False
        self.by_name: Mapping[str, Floats] = kept

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the names, shapes and bytes."""
        collected = hashlib.sha256()
        for name in sorted(self.by_name):
            collected.update(f"{name} {self.by_name[name].shape}".encode())
            collected.update(self.by_name[name].tobytes())
        return collected.hexdigest()

    def __getitem__(self, name: str) -> Floats:
        """Return an array."""
        return self.by_name[name]

    def __eq__(self, other: object) -> bool:
        """Return whether the other has the same arrays."""
        return isinstance(other, MapArrays) and self.digest == other.digest

    def __hash__(self) -> int:
        """Return a hash of the arrays."""
        return hash(self.digest)

    def __repr__(self) -> str:
        """Return how many numbers there are."""
        return f"<{sum(array.size for array in self.by_name.values())} numbers>"


UNLIMITED = 1e300
"""A limit that nothing reaches. Source: definition (no limit)."""


class LearnedMap(Description):
    """What logs taught of some joints: y = φ(x)ᵀ b + e with b ~ N(mean, covariance), e ~ N(0, σ²).

    φ has a constant, the scaled readings, the slips of their plays, what they are ahead of their
    lags, and radial functions of readings and slips, see docs/explanation/map.md. Readings are
    those of the `channels`, then, beside a filter, its angles of the `joints`.
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)

    joints: tuple[str, ...] = Field(min_length=1, description="of `efforts` the sensors")
    channels: tuple[str, ...] = Field(min_length=1)
    positions: tuple[str, ...] = Field((), description="those that are positions")
    beside_filter: bool = Field(False, description="whether it corrects the filter's angles")
    logs: int = Field(ge=0, description="0: only a homing move")
    low: Row = Field(description="of each reading")
    high: Row = Field(description="of each reading")
    rms: Row = Field((), description="error on logs left out")
    inside: Row = Field((), description=f"share inside the {COVERED_TEXT} band")
    normal: tuple[float, float] = Field(
        (UNLIMITED, UNLIMITED), description="of `efforts`: largest normal means of T²"
    )
    answers: bool = Field(
        False,
        description="of `readings`: whether the angles are its own, or pooled with a filter's",
    )
    arrays: MapArrays = Field(description="from the file beside the rig file")

    @property
    def count(self) -> int:
        """Number of its readings, the filter's angles included."""
        return len(self.channels) + (len(self.joints) if self.beside_filter else 0)

    @property
    def reach(self) -> dict[str, tuple[float, float]]:
        """Channel → its range in the logs, wider at each end by the share `WIDER`."""
        return {
            name: (low - WIDER * (high - low), high + WIDER * (high - low))
            for name, low, high in zip(self.channels, self.low, self.high)
        }

    @property
    def moving(self) -> tuple[int, ...]:
        """Indices of the readings whose slips enter the radial functions."""
        indices = [i for i, name in enumerate(self.channels) if name in self.positions]
        return (*indices, *range(len(self.channels), self.count))

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Name → shape of each array: M radial functions, n features, and J joints."""
        radial = len(self.arrays.by_name.get("points", ()))
        inputs = self.count + len(self.moving)
        features = features_of(self.count) + radial
        joints = len(self.joints)
        return {
            "centre": (self.count,),
            "scale": (self.count,),
            "rate": (self.count,),
            "play": (1,),
            "lengths": (inputs,),
            "points": (radial, inputs),
            "root": (radial, radial),
            "mean": (joints, features),
            "covariance": (joints, features, features),
            "radial": (joints,),
            "noise": (joints,),
            "filter": (joints,),
            "error_time": (joints,),
            "correlation": (joints, joints),
        }

    @property
    def structure(self) -> tuple[object, ...]:
        """What decides the equations of the map; all else is a number in them."""
        return self.joints, self.channels, self.moving, self.count, self.shapes["root"]

    @model_validator(mode="after")
    def _arrays_fit(self) -> Self:
        for name, shape in self.shapes.items():
            array = self.arrays.by_name.get(name)
            if array is None or array.shape != shape:
                came = "none" if array is None else f"one of {array.shape}"
                raise ValueError(f"arrays: {name} must be an array of {shape}; {came} came")
            if not np.isfinite(array).all():
                raise ValueError(f"arrays: {name} has a value that is not finite")
        for name in ("scale", "lengths"):
            if not np.all(self.arrays[name] > 0.0):
                raise ValueError(f"arrays: every {name} must be positive")
        for name in ("low", "high"):
            if len(getattr(self, name)) != self.count:
                raise ValueError(f"{name} must have {self.count} entries")
        return self


def features_of(count: int) -> int:
    """Return the number of features of `count` readings, without radial functions."""
    return 1 + count * (1 + len(HALF_WIDTHS) + len(TIME_CONSTANTS))


class LearnedMaps(Description):
    """The table `[map]`: for each kind one map for each independent part of the rig."""

    readings: tuple[LearnedMap, ...] = Field(
        (), description="angles for the estimator `regression`"
    )
    filter: tuple[LearnedMap, ...] = Field((), description="errors of the filter's angles")
    efforts: tuple[LearnedMap, ...] = Field(
        (), description="forces and tensions in free motion, for the health"
    )

    @property
    def alone(self) -> bool:
        """Whether the angles are those of readings alone, since no filter could follow the logs."""
        answers = all(learned.answers for learned in self.readings)
        return answers and bool(self.readings) and not self.filter

    @property
    def pooled(self) -> tuple[LearnedMap, ...]:
        """The maps on readings alone that share each angle with those beside the filter."""
        shared = self.filter and all(learned.answers for learned in self.readings)
        return self.readings if shared else ()

    def named(self) -> dict[str, LearnedMap]:
        """Return kind and index → map, as ``filter.0``."""
        return {
            f"{kind}.{i}": learned
            for kind in KINDS
            for i, learned in enumerate(getattr(self, kind))
        }


def arrays_file(rig_file: str | Path) -> Path:
    """Return the path of the file with the numbers of a rig file's maps."""
    path = Path(rig_file)
    return path.with_name(f"{path.stem}.map.npz")


def as_table(maps: LearnedMaps, rig_file: str | Path) -> tuple[Raw, bytes]:
    """Return the table `[map]` of a rig file, and the bytes of the file beside it."""
    arrays = {
        f"{name}.{part}": array
        for name, learned in maps.named().items()
        for part, array in learned.arrays.by_name.items()
    }
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    content = stream.getvalue()
    table: Raw = {
        "file": arrays_file(rig_file).name,
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    elsewhere = {kind: {"__all__": {"arrays"}} for kind in KINDS}
    return table | maps.model_dump(exclude=elsewhere, exclude_defaults=True), content


def with_arrays(raw: Mapping[str, object], source: str, folder: Path) -> Raw:
    """Return a raw description whose table `[map]` has its numbers, from the file that it names in
    the rig's own folder; unchanged where it has no such table.

    Raises:
        RigError: the file is missing, is another one, or lies elsewhere.
    """
    table = raw.get("map")
    if not isinstance(table, dict) or "file" not in table:
        return dict(raw)
    kept = dict(table)
    name = kept.pop("file")
    digest = kept.pop("sha256", None)
    if not isinstance(name, str) or Path(name).name != name or not name.endswith(".npz"):
        raise RigError(f"{source}: map.file is the name of an .npz file beside it; {name!r} came")
    try:
        content = (folder / name).read_bytes()
    except OSError as problem:
        raise RigError(
            f"{source}: [map] needs the file {name} beside the rig file ({problem.strerror}); copy "
            "it there, or remove [map]"
        ) from None
    if hashlib.sha256(content).hexdigest() != digest:
        raise RigError(
            f"{source}: {name} is not the file that was written with this rig (its SHA-256 is "
            "another one); copy the right one there, fit again, or remove [map]"
        )
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            collected = {key: arrays[key] for key in arrays.files}
    except (OSError, ValueError, zipfile.BadZipFile) as problem:
        raise RigError(f"{source}: {name} cannot be read ({problem}); fit again") from None
    for kind in KINDS:
        maps = kept.get(kind)
        if isinstance(maps, list):
            kept[kind] = [
                {**learned, "arrays": _among(collected, f"{kind}.{i}.")}
                for i, learned in enumerate(maps)
            ]
    return {**raw, "map": kept}


def _among(arrays: Mapping[str, Floats], prefix: str) -> MapArrays:
    return MapArrays(
        **{name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
    )


class LeftOut(Description):
    """How well a rig did on logs that were left out of its fit."""

    logs: int = Field(gt=0)
    rms: float = Field(ge=0.0, description="error of the angles [rad]")
    inside: float = Field(ge=0.0, le=1.0, description=f"share inside the {COVERED_TEXT} band")

    def in_words(self) -> str:
        """Return a line on the errors of the angles."""
        return (
            f"on {self.logs} logs left out of its fit the rig errs by "
            f"{rounded(degrees(self.rms))}°, {100 * self.inside:.0f} % inside the "
            f"{COVERED_TEXT} band"
        )

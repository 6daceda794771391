"""The folder of a study, which holds its rows: a small Parquet file for each chunk, written whole
when the chunk ends.
"""

from __future__ import annotations

import io
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.errors import StudyError
from distal.logs import write_whole
from distal.results import make_folder
from distal.study.description import Plan
from distal.study.design_space import ESTIMATOR, FEEDBACK
from distal.study.runs import BUILT, Rows
from distal.version import __version__

if TYPE_CHECKING:
    import pyarrow

Columns = dict[str, NDArray[np.generic]]

LABEL = "study.json"
"""Name of the file that says to which study a folder belongs."""


@dataclass(frozen=True)
class Folder:
    """The folder of a study's rows and its answer; `texts` are the columns that hold text."""

    path: Path
    texts: frozenset[str]

    def done(self) -> set[int]:
        """Return the numbers of the chunks whose rows are in the folder."""
        matches = (
            re.fullmatch(r"(\d+)\.parquet", file.name) for file in (self.path / "rows").iterdir()
        )
        return {int(match[1]) for match in matches if match}

    def write(self, chunk: int, rows: Rows) -> None:
        """Write the rows of a chunk."""
        write_whole(self.path / "rows" / f"{chunk:06d}.parquet", _bytes(self._table(rows)))

    def _table(self, rows: Rows) -> pyarrow.Table:
        import pyarrow as pa

        kinds = {
            "design": pa.int32(),
            "seed": pa.int32(),
            "met": pa.bool_(),
            **dict.fromkeys(self.texts, pa.string()),
        }
        kinds |= {name: pa.float32() for name in rows if name.startswith(BUILT)}
        return pa.table(
            {name: pa.array(cells, kinds.get(name, pa.float64())) for name, cells in rows.items()}
        )

    def gather(self) -> Path:
        """Write the rows of all chunks into one file, ``rows.parquet``, sorted by design, seed and
        scenario, and return its path.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        parts = [
            pq.read_table(self.path / "rows" / f"{chunk:06d}.parquet")
            for chunk in sorted(self.done())
        ]
        table = pa.concat_tables(parts).sort_by(
            [(name, "ascending") for name in ("design", "seed", "scenario")]
        )
        write_whole(self.path / "rows.parquet", _bytes(table))
        return self.path / "rows.parquet"

    def read(self) -> Columns:
        """Return the gathered rows, column → values. In ``met`` 1 stands for yes, 0 for no, and -1
        where the requirement does not ask for the scenario.

        Raises:
            StudyError: there are no rows.
        """
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(self.path / "rows.parquet")
        except OSError as problem:
            raise StudyError(f"{self.path}: has no rows that can be read ({problem})") from None
        return {
            name: (
                table[name].cast("int8").fill_null(-1) if name == "met" else table[name]
            ).to_numpy()
            for name in table.column_names
        }


def _bytes(table: pyarrow.Table) -> bytes:
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    return buffer.getvalue()


def open_folder(plan: Plan, path: str | Path) -> Folder:
    """Return a study's folder, which is made if it does not exist; the rows of this study that it
    holds are kept.

    Raises:
        StudyError: the folder is of another study or another version of distal, or pyarrow is not
            installed.
        OutputError: the folder cannot be made or written.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise StudyError(
            "a study's rows are Parquet, which needs pyarrow; pip install '.[study]'"
        ) from None
    folder = make_folder(Path(path) / "rows").parent
    label = folder / LABEL
    texts = {"scenario", "problem"} | {ESTIMATOR, FEEDBACK} & plan.study.vary.keys()
    if label.exists():
        _check(label, plan)
    else:
        names = {
            "digest": plan.digest,
            "version": __version__,
            "name": plan.study.name,
            "rig": plan.rig.name,
        }
        write_whole(label, json.dumps(names, indent=2, ensure_ascii=False) + "\n")
    return Folder(folder, frozenset(texts))


def _check(label: Path, plan: Plan) -> None:
    try:
        names = json.loads(label.read_text(encoding="utf-8"))
        digest = names["digest"]
        version = names["version"]
    except (OSError, ValueError, KeyError, TypeError):
        raise StudyError(
            f"{label}: cannot be read; give another folder with --out, or remove this one"
        ) from None
    if digest != plan.digest:
        raise StudyError(
            f"{label.parent}: holds another study's rows; give another folder with --out, or "
            "remove it"
        )
    if version != __version__:
        raise StudyError(
            f"{label.parent}: was begun with distal {version}, this is {__version__}; give "
            "another folder with --out"
        )

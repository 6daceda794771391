"""Files that are wrong, by the power-on routine: the smallest case of the benchmark."""

from __future__ import annotations

import pytest

from benchmarks.wrong_files import KINDS, MEASURED, drawn, judged


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, ""])
def test_a_wrong_file_is_named_and_changed_only_with_consent(kind: str) -> None:
    found = judged(drawn(24, kind, MEASURED))
    assert found.first == bool(kind)
    assert not found.changed
    assert found.accused == 0
    assert found.off < 1.5

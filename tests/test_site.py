"""`make docs`: every page is there, links lead somewhere, every public name is in the reference,
nothing is fetched.
"""

from __future__ import annotations

import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest

import distal

ROOT = Path(__file__).parents[1]


def test_the_reference_names_everything() -> None:
    named = re.findall(
        r"(?m)^::: distal\.(\w+)$", (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    )
    assert sorted(named) == sorted(distal.__all__)


@pytest.mark.slow
def test_the_site(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="the extra 'docs' is not installed")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(tmp_path / "site")]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    texts = {
        path.relative_to(tmp_path / "site").as_posix(): path.read_text(encoding="utf-8")
        for path in (tmp_path / "site").rglob("*.html")
    }
    sources = {
        path.relative_to(ROOT / "docs").with_suffix(".html").as_posix()
        for path in (ROOT / "docs").rglob("*.md")
    }
    assert sources | {"index.html", "contributing.html", "changelog.html"} <= set(texts)
    loaded = r"""(?:<link[^>]*\srel=.(?:stylesheet|icon)[^>]*\shref|\ssrc)=["']?\w+://"""
    assert [name for name, text in texts.items() if re.search(loaded, text)] == []
    for public in distal.__all__:
        assert f'id="distal.{public}"' in texts["reference.html"], public


def test_what_is_missing_is_an_error() -> None:
    """A page that no menu names, a link that leads nowhere, to a page or within it: `--strict`
    makes errors of warnings.
    """
    config = pytest.importorskip("mkdocs.config", reason="the extra 'docs' is not installed")
    checks = config.load_config(str(ROOT / "mkdocs.yml")).validation
    nav, links = checks.nav, checks.links
    levels = [nav.omitted_files, nav.not_found, links.not_found, links.anchors]
    assert levels == [logging.WARNING] * 4

"""`make docs`: every page is there, links lead somewhere, every public name is in the reference,
nothing is fetched.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from posixpath import normpath
from urllib.parse import unquote

import pytest

import distal

ROOT = Path(__file__).parents[1]


def test_the_reference_names_everything() -> None:
    named = re.findall(
        r"(?m)^::: distal\.(\w+)$", (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    )
    assert sorted(named) == sorted(distal.__all__)


class Links(HTMLParser):
    """What a page links to and loads, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        held = {name: value or "" for name, value in attrs}
        self.anchors |= {held[name] for name in ("id", "name") if name in held}
        if tag == "a" and "href" in held:
            self.links.append(held["href"])
        self.loaded += [held[name] for name in ("src",) if name in held]
        if tag == "link" and held.get("rel") in ("stylesheet", "icon"):
            self.loaded.append(held["href"])


def built(out: Path, config: Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(config), "-d", str(out)]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_the_site(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="the extra 'docs' is not installed")
    done = built(tmp_path / "site", ROOT / "mkdocs.yml", ROOT)
    assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    pages = {
        path.relative_to(site).as_posix(): Links(path.read_text(encoding="utf-8"))
        for path in site.rglob("*.html")
    }
    sources = {
        path.relative_to(ROOT / "docs").with_suffix("").as_posix()
        for path in (ROOT / "docs").rglob("*.md")
    }
    assert {
        f"{name}.html" for name in sources | {"index", "contributing", "changelog", "ros2"}
    } <= set(pages)
    for name, page in pages.items():
        for target in page.loaded:
            assert "://" not in target, f"{name} loads {target}"
        for link in page.links:
            target, _, anchor = link.partition("#")
            if "://" in target or target.startswith(("mailto:", "/")) or name == "404.html":
                continue
            leads = normpath(str(PurePosixPath(name).parent / unquote(target))) if target else name
            assert (site / leads).exists(), f"{name}: {link}"
            held = pages.get(leads)
            assert not anchor or held is None or unquote(anchor) in held.anchors, f"{name}: {link}"
    for public in distal.__all__:
        assert f"distal.{public}" in pages["reference.html"].anchors, public


@pytest.mark.slow
def test_what_is_missing_fails(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="the extra 'docs' is not installed")
    for name in ("docs", "src", "tools", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in (
        "mkdocs.yml",
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "SECURITY.md",
        "LICENSE",
    ):
        shutil.copyfile(ROOT / name, tmp_path / name)
    # the page of all names takes most of the time, and has no links
    (tmp_path / "docs" / "reference.md").write_text("# Reference\n", encoding="utf-8")
    with (tmp_path / "docs" / "how-to" / "live.md").open("a", encoding="utf-8") as file:
        file.write("\n[dead](nowhere.md) [dead](../explanation/model.md#nowhere)\n")
    (tmp_path / "docs" / "stray.md").write_text("# Not in the menu\n", encoding="utf-8")
    done = built(tmp_path / "site", tmp_path / "mkdocs.yml", tmp_path)
    assert done.returncode != 0
    for said in ("nowhere.md", "model.md#nowhere", "stray.md"):
        assert said in done.stderr

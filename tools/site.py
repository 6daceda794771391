"""What mkdocs needs beside docs/: the README as the first page, and links to files of the
repository that lead somewhere.

`make docs` calls the two functions at the end.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]

PAGES = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
    "security.md": "SECURITY.md",
    "ros2.md": "examples/ros2/README.md",
}
"""Page of the site → file of the repository."""

LAB = "<iframe src='lab.html' title='The lab' style='width:100%;height:75rem;border:0'></iframe>"
"""The lab of the paper's rig, with which the site opens."""

FOLDER = "repository"
"""Where the site has files that pages link to and that are no pages."""

LINK = re.compile(r"(\]\()([^)#\s]+)((?:#[^)\s]*)?\))")


def linked(text: str, folder: Path) -> dict[str, Path]:
    """Return link → file of the repository outside docs/ for what a page links to.

    Args:
        text: of the page.
        folder: that its links count from.
    """
    found = {}
    for _, target, _ in LINK.findall(text):
        if "://" in target or target.startswith("mailto:"):
            continue
        path = (folder / target).resolve()
        if path.exists() and path.is_relative_to(ROOT) and not path.is_relative_to(ROOT / "docs"):
            found[target] = path
    return found


def rewritten(text: str, folder: Path, page: str) -> str:
    """Return a page with links as they are on the site.

    Args:
        text: of the page.
        folder: that its links count from.
        page: where the site has it.
    """
    pages = {(ROOT / source).resolve(): target for target, source in PAGES.items()}

    def to_site(match: re.Match[str]) -> str:
        target = match[2]
        if "://" in target:
            return match[0]
        path = (folder / target).resolve()
        if path.is_dir() and (path / "README.md").exists():
            path /= "README.md"
        if path in pages:
            found = pages[path]
        elif path.exists() and path.is_relative_to(ROOT / "docs"):
            found = path.relative_to(ROOT / "docs").as_posix()
        elif path.is_file():
            found = f"{FOLDER}/{path.relative_to(ROOT).as_posix()}"
        else:
            return match[0]
        return f"{match[1]}{os.path.relpath(found, Path(page).parent)}{match[3]}"

    return LINK.sub(to_site, text)


def on_files(files: Files, config: Any) -> Files:
    """Add the README and its like, and the files of the repository that pages link to."""
    sources = [
        (file.content_string, (ROOT / "docs" / file.src_uri).parent)
        for file in files
        if file.src_uri.endswith(".md")
    ]
    for page, source in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        folder = (ROOT / source).parent
        content = rewritten(text, folder, page)
        if page == "index.md":
            content = content.replace("## Your own log", f"{LAB}\n\n## Your own log", 1)
        files.append(File.generated(config, page, content=content))
        sources.append((text, folder))
    known = {(ROOT / source).resolve() for source in PAGES.values()}
    for text, folder in sources:
        for path in linked(text, folder).values():
            path = path / "README.md" if path.is_dir() else path
            if path.is_file() and path not in known:
                known.add(path)
                where = f"{FOLDER}/{path.relative_to(ROOT).as_posix()}"
                files.append(File.generated(config, where, content=path.read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Let links of a page in docs/ lead to where the site has their targets."""
    where = page.file.src_uri
    return (
        markdown if where in PAGES else rewritten(markdown, (ROOT / "docs" / where).parent, where)
    )

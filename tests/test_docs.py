"""What the documentation says is there: arguments, commands, keys, examples."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import shlex
import textwrap
import tomllib
from pathlib import Path
from typing import Any

import pytest
from tools.size import sizes

import distal
from tests.rig.mjcf.models import FINGER

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))
GENERATED = ("reference/rig-keys.md", "reference/scenario-keys.md", "reference/study-keys.md")
MODULES = sorted(module.name for module in pkgutil.walk_packages(distal.__path__, "distal."))


def public_callables(name: str) -> list[tuple[str, object]]:
    if name == "distal.bridges.lerobot_step":
        pytest.importorskip("lerobot")
    module = importlib.import_module(name)
    found: list[tuple[str, object]] = []
    for key, value in vars(module).items():
        if key.startswith("_") or getattr(value, "__module__", None) != name:
            continue
        if inspect.isfunction(value):
            found.append((f"{name}.{key}", value))
        elif inspect.isclass(value):
            found += [
                (f"{name}.{key}.{k}", v)
                for k, v in vars(value).items()
                if inspect.isfunction(v) and not k.startswith("_") and v.__module__ == name
                # what a method of a base class takes is said there
                if not any(k in vars(base) for base in value.__mro__[1:])
            ]
    return found


PARAMETERS = re.compile(r"\b(Floats|Bools|NDArray|Scalar|Vector|Matrix|float)\b")
"""Types whose unit or shape a name does not say."""

FILLER = re.compile(
    r"(?m)^\s+\w+: (the )?(rig|description|log|model|function|plant|states|options|its index)\.$"
)
"""What only repeats the name of an argument."""


@pytest.mark.parametrize("name", [name for name in MODULES if ".cli" not in name])
def test_arguments_are_documented_where_their_names_and_types_do_not_say_it(name: str) -> None:
    """Numbers and arrays have a unit or a shape, so each has its line or is named in the sentence;
    others where there is more to say. What is documented is an argument.
    """
    missing, unknown = [], []
    for path, function in public_callables(name):
        doc = inspect.getdoc(function) or ""
        assert doc, f"{path} has no docstring"
        assert not FILLER.search(doc), f"{path}: {FILLER.search(doc)}"
        arguments = {
            k: v
            for k, v in inspect.signature(function).parameters.items()
            if k not in ("self", "cls")
        }  # type: ignore[arg-type]
        for argument, parameter in arguments.items():
            needs = len(arguments) > 1 and PARAMETERS.search(str(parameter.annotation))
            if needs and not re.search(rf"(?m)(^\s+{argument}: |\b{argument}\b|`{argument}`)", doc):
                missing.append(f"{path}: {argument}")
        section = re.search(r"(?ms)^Args:\n(.*?)(^\S|\Z)", doc)
        identified = re.findall(r"(?m)^    \*{0,2}(\w+): ", section[1]) if section else []
        unknown += [f"{path}: {argument}" for argument in identified if argument not in arguments]
    assert not missing
    assert not unknown


def test_package_files_only_re_export() -> None:
    """But for distal's own, which re-exports when a name is first used: see
    `test_every_public_name_is_found`.
    """
    for file in (ROOT / "src" / "distal").rglob("*/__init__.py"):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            kind = type(node).__name__
            is_all = kind == "Assign" and getattr(node.targets[0], "id", "") == "__all__"  # type: ignore[attr-defined]
            assert kind in ("Expr", "ImportFrom") or is_all, f"{file}: {kind}"


def test_modules_are_short() -> None:
    """No module is larger than what is read at once."""
    assert {name: size for name, size in sizes().items() if size > 6000} == {}


def examples(page: str) -> list[str]:
    """Return the Python of a page."""
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.S)


@pytest.mark.slow
def test_the_first_example_of_the_readme_runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the folder of the repository, whose logs it names."""
    first, _ = examples("../README.md")
    assert len(first.strip().splitlines()) <= 12
    monkeypatch.chdir(ROOT)
    exec(compile(first, "README.md", "exec"), {})
    assert "100 % inside the band" in capsys.readouterr().out


@pytest.mark.parametrize("page", ["../README.md", *(page for page in PAGES if examples(page))])
def test_the_examples_of_the_docs_run(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "finger.xml").write_text(FINGER, encoding="utf-8")  # a model that a page reads
    for code in examples(page)[page == "../README.md" :]:
        exec(compile(code, page, "exec"), {})


def test_pictures_and_pages_that_are_named_exist() -> None:
    others = [
        ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")
    ]
    for page in [*others, *(DOCS / name for name in PAGES)]:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
            if not target.startswith("http"):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_what_the_page_on_security_says_of_the_code_is_so() -> None:
    """No pickle is loaded and nothing is evaluated; what it names is there; other programs are
    started in one file.
    """
    said = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    sources = {
        path.name: path.read_text(encoding="utf-8") for path in (ROOT / "src/distal").rglob("*.py")
    }
    for name, text in sources.items():
        assert not re.search(
            r"(?<![\w.])(eval|exec)\(|pickle\.loads?\(|allow_pickle=True|shell=True", text
        ), name
    starts = {name for name, text in sources.items() if re.search(r"subprocess\.(run|Popen)", text)}
    assert starts == {"compiler.py"}
    for variable in ("DISTAL_COMPILE", "DISTAL_CACHE"):
        assert variable in said
        assert any(variable in text for text in sources.values())


def test_the_reference_is_up_to_date() -> None:
    from tools.reference import PAGES as PAGES_OF_KEYS
    from tools.reference import written

    assert sorted(f"reference/{page}" for page in PAGES_OF_KEYS) == sorted(GENERATED)
    for page in PAGES_OF_KEYS:
        text = (DOCS / "reference" / page).read_text(encoding="utf-8")
        assert text == written(page), "run python -m tools.reference"


def blocks(page: str, kind: str) -> list[str]:
    """Return the fenced blocks of a kind on a page, those within lists too."""
    found = re.findall(
        rf"(?ms)^( *)```{kind}\n(.*?)^ *```", (DOCS / page).read_text(encoding="utf-8")
    )
    return [textwrap.dedent(text) for _, text in found]


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "toml")])
def test_toml_of_the_docs_is_valid(page: str) -> None:
    for text in blocks(page, "toml"):
        tomllib.loads(text)


def commands(page: str) -> list[list[str]]:
    """Return the calls of distal on a page, word by word, without comments and what stands behind a
    pipe.
    """
    lines = [line for text in blocks(page, "sh") for line in text.replace("\\\n", " ").splitlines()]
    calls = [
        re.split(r"[|<>]", line[line.index("distal ") :])[0]
        for line in lines
        if re.search(r"(^|\| )distal ", line)
    ]
    return [shlex.split(call, comments=True) for call in calls]


def test_commands_of_the_docs_exist() -> None:
    import typer

    from distal.cli import app

    checked = 0
    for page in PAGES:
        for words_of_call in commands(page):
            command: Any = typer.main.get_command(app)
            rest = words_of_call[1:]
            while rest and rest[0] in getattr(command, "commands", {}):
                command = command.commands[rest.pop(0)]
            assert not hasattr(command, "commands"), f"{page}: {words_of_call}"
            known = {
                option
                for parameter in command.params
                for option in (*parameter.opts, *parameter.secondary_opts)
            }
            for word in rest:
                assert not re.match(r"--?[a-z]", word) or word in known, (
                    f"{page}: {word} of {words_of_call}"
                )
            checked += 1
    assert checked > 30


def test_pages_that_code_names_exist() -> None:
    folders = ("src", "tests", "tools", "benchmarks", "examples")
    files = [
        path
        for folder in folders
        for kind in ("*.py", "*.toml")
        for path in (ROOT / folder).rglob(kind)
    ]
    for file in files:
        for page in re.findall(r"\bdocs/[\w/-]+\.md", file.read_text(encoding="utf-8")):
            assert (ROOT / page).exists(), f"{file.relative_to(ROOT)}: {page}"


def words(page: str) -> int:
    """Return how many words a page has; bars of tables and other signs alone are none."""
    return sum(
        bool(re.search(r"\w", word)) for word in (DOCS / page).read_text(encoding="utf-8").split()
    )


def test_the_documentation_is_short() -> None:
    """Said once: all of it in less than 30,000 words, a page in 3,000, a task in 800."""
    looked_up = (*GENERATED, "reference/glossary.md")
    counted = {page: words(page) for page in PAGES if page not in looked_up}
    text = "".join(page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))
    assert len(text.split()) <= 30_000
    assert {page: count for page, count in counted.items() if count > 3000} == {}
    assert {
        page: count for page, count in counted.items() if page.startswith("how-to/") and count > 800
    } == {}

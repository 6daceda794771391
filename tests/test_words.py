"""Names of variables and arguments are nouns of the field; words that stand for any thing are
counted.
"""

from pathlib import Path

from tools.words import FILLERS, OTHERS, SOURCE, bindings, counted, retired, words_of

MOST = 150
"""So many bindings of all fillers together, in a package that had 1,017."""

BEFORE = {
    "item": 6,
    "value": 164,
    "single": 7,
    "data": 69,
    "result": 31,
    "info": 7,
    "entry": 10,
    "element": 1,
    "other": 39,
    "others": 18,
    "given": 35,
    "kept": 47,
    "now": 15,
    "here": 2,
    "what": 20,
    "ones": 2,
    "both": 6,
    "many": 1,
}
"""How often other such words stood there before: they must not take the fillers' place."""


def test_names_say_what_they_are() -> None:
    counts = counted()
    assert sum(counts[word] for word in FILLERS) <= MOST
    assert {word: counts[word] for word in OTHERS if counts[word] > BEFORE.get(word, 0)} == {}


def test_no_name_has_a_word_that_the_glossary_retired() -> None:
    """A name of a module, class, function, argument or variable says what the glossary calls it."""
    words = set(retired())
    assert {"place", "numbers", "carry"} <= words
    named = [(path, name) for path in SOURCE.rglob("*.py") for _, name in bindings(path)]
    named += [(path, path.stem) for path in SOURCE.rglob("*.py")]
    assert [f"{path.name}: {name}" for path, name in named if words & set(words_of(name))] == []


def test_words_of_names() -> None:
    assert words_of("readPlaces_of2") == ["read", "places", "of2"]
    assert words_of("written_in_place") == ["written"]


def test_every_way_to_bind_a_name_is_seen(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        "def found(own, *rest, known=1, **told):\n"
        "    one: int = own\n"
        "    for each in rest:\n"
        "        made, (there, said) = each\n"
        "    return [whole for whole in rest] + [lambda item: item]\n"
        "try:\n    pass\nexcept OSError as value:\n    pass\n"
        "class thing:\n    data: int\n"
        "with open('x') as result, open('y'):\n    print(other := 1)\n"
    )
    names = sorted(name for _, name in bindings(module))
    expected = [*FILLERS, "item", "value", "thing", "data", "result", "other"]
    assert names == sorted(expected)
    assert counted(tmp_path).total() == len(expected)

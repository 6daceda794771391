"""One symbol, one meaning, on the pages of the adaptive filter, in its twin and its docstrings; and
a fault is found.
"""

from __future__ import annotations

import pytest
from tools.symbols import (
    definitions_of,
    faults,
    identified_in,
    is_marked,
    listed,
    plain,
    read,
    symbols_of,
)

HEAD = "|symbol|meaning|unit|where|\n|---|---|---|---|\n"
GOOD_TABLE = HEAD + "|s|place|m|1|\n|κ|sticking|1|2|\n|T_s|time|s|2|\n|σ|std|m|1|\n"
GOOD_PAGE = "The drive at s.\n\n    κ = s/T_s    (1)\n    σ² = s²\n"


def test_every_symbol_has_one_line_and_one_meaning() -> None:
    assert faults(*read()) == []


def test_the_table_is_not_empty() -> None:
    table, pages, code = read()
    assert len(listed(table)) > 100
    assert len(code) > 15
    assert sum(1 for page in pages.values() for _ in definitions_of(plain(page))) > 40


def test_symbols_are_letters_with_accents_primes_and_subscripts() -> None:
    text = "s⁺ = s̃ + 2σ_s² − v̄ dt, R' of K_i (π₋ + π₊), e^{−t/T_m}, P_z· and Ū/σ₀"
    found = {"s", "s̃", "σ_s", "v̄", "dt", "R'", "K_i", "π₋", "π₊", "t", "T_m", "P_z", "Ū", "σ₀"}
    assert symbols_of(plain(text)) == found
    assert symbols_of("Σ_drives Σ_s e⁻¹") == set()
    assert symbols_of(plain("a drive's `K_s` is [here](K_t.md), 2.5 words")) == {"a"}


def test_what_goes_on_in_the_next_line_belongs_to_a_definition() -> None:
    text = "    Λ = min(a, 50)\n        + b    (2)\n    u⁺ = 3\n    x ← 4\n"
    assert list(definitions_of(plain(text))) == [("Λ", "min(a,50)+b")]


def test_conditions_and_updates_define_nothing() -> None:
    text = "It is left out if σ = 0, where κ = 1 and for k = 2; s⁺ = 3."
    assert list(definitions_of(plain(text))) == []


def test_a_page_without_a_fault_has_none() -> None:
    assert faults(GOOD_TABLE, {"page": GOOD_PAGE}, {}) == []


@pytest.mark.parametrize(
    ("table", "page", "code", "said"),
    [
        (GOOD_TABLE, GOOD_PAGE + "\n    s⁺ = s + γ_q\n", "", "page: γ_q is not in"),
        (GOOD_TABLE, GOOD_PAGE + "\nwith the bend b̄ of it\n", "", "page: b̄ is not in"),
        (GOOD_TABLE + "|κ|share of the gain|1|3|\n", GOOD_PAGE, "", "κ stands 2 times"),
        (
            GOOD_TABLE + "|σ_0|one|1|3|\n|σ₀|alike|1|3|\n",
            GOOD_PAGE + "σ_0\n",
            "",
            "σ₀ stands 2 times",
        ),
        (GOOD_TABLE + "|χ|unused|1|3|\n", GOOD_PAGE, "", "χ is used nowhere"),
        (
            GOOD_TABLE,
            GOOD_PAGE + "\n    κ = 1 − s    (2)\n",
            "",
            "page: κ = 1−s, but s/T_s in page",
        ),
        (
            GOOD_TABLE,
            GOOD_PAGE + "\nFar away, with κ = T_s, it rests.\n",
            "",
            "page: κ = T_s, but s/T_s",
        ),
        (GOOD_TABLE, GOOD_PAGE, '"""Return γ of it."""\n', "code: γ is not in"),
        (GOOD_TABLE, GOOD_PAGE, 'def f():\n    """κ = 3 s"""\n', "code: κ = 3s, but s/T_s in page"),
    ],
)
def test_a_fault_that_is_planted_is_found(table: str, page: str, code: str, said: str) -> None:
    assert any(said in fault for fault in faults(table, {"page": page}, {"code": code}))


def test_names_of_code_are_no_symbols() -> None:
    text = identified_in('"""The `z_k` of `σ`: (n_joints,)."""\nK_s = 1  # ω by T_m\n')
    assert {symbol for symbol in symbols_of(text) if is_marked(symbol)} == {"ω", "T_m"}

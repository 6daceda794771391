"""What a user may have meant by a name that is not known."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(word: str, allowed: Iterable[str]) -> str:
    """Return a hint that names the nearest allowed word and lists all, e.g. ``; did you mean
    'mass'? (known: …)``.
    """
    names = sorted(name if len(name) <= 40 else name[:39] + "…" for name in allowed)
    near = get_close_matches(word, names, n=1, cutoff=0.5)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    more = f" and {len(names) - 20} more" if len(names) > 20 else ""
    return f"{hint} (known: {', '.join(names[:20])}{more})" if names else hint

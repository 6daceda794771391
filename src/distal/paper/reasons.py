"""Why statements of the 2008 paper fare as they do, in words."""

REASONS: dict[str, str] = {}

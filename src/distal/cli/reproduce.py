"""`distal reproduce`."""


def reproduce_command() -> None:
    """Later."""

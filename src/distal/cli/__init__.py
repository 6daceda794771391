"""The command line."""

from distal.cli.app import app, main

__all__ = ["app", "main"]

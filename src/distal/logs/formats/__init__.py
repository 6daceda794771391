"""Formats of logs, one file for each; the list of them is in `registry`."""

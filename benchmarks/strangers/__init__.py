"""Logs and rigs that distal was not built with; `python -m benchmarks.strangers`."""

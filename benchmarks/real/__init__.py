"""Real logs of tendon-driven joints that no rig file describes: `python -m benchmarks.real`."""

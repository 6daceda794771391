"""The command `distal`: a module of its own, so that Ctrl-C while the packages are imported is no traceback either."""

import sys


def main() -> None:
    """Run the command line."""
    try:
        from distal.cli import main as run
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(130)
    run()

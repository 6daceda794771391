"""The command `distal`: a module of its own, so that Ctrl-C while the packages are imported is no
traceback either.
"""

import sys


def main() -> None:
    """Run the command line."""
    try:
        from distal.cli import main as run
    except BaseException as problem:
        # a package that is being imported may wrap the interrupt in an error of its own
        if not isinstance(problem, KeyboardInterrupt) and "KeyboardInterrupt" not in repr(problem):
            raise
        print("stopped", file=sys.stderr)
        sys.exit(130)
    run()

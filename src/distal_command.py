"""The command `distal`, which Ctrl-C ends wherever it comes, also while packages are imported."""

import _thread
import signal
import sys
import threading
from types import FrameType

RETRY = 0.01
"""Time after which an interrupt is tried again [s]. Source: definition (two turns of threads)."""


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, later where it would be lost.

    What is raised while CasADi converts its arguments goes nowhere; while a package is imported or
    a process started, it may go nowhere or become another error.
    """
    while frame is not None:
        package = frame.f_globals.get("__name__", "").partition(".")[0]
        if (
            package in ("casadi", "importlib", "_frozen_importlib")
            or frame.f_code.co_name == "_execute_child"  # of subprocess.Popen
        ):
            again = threading.Timer(RETRY, _thread.interrupt_main)
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    try:
        from distal.cli import main as run

        run()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(130)

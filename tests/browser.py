"""A page in headless Chromium, asked through its debugging pipe: what it shows after time has
passed or a key.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

BROWSER = (
    shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
)


class Page:
    """An open page.

    Args:
        to_browser: end of a pipe.
        from_browser: end of another.
    """

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._out, self._in = to_browser, os.fdopen(from_browser, "rb")
        self._sent, self._session = 0, ""

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the answer to a command of the Chrome DevTools Protocol."""
        self._sent += 1
        message = {"id": self._sent, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            text = bytearray()
            while (byte := self._in.read(1)) not in (b"\0", b""):
                text += byte
            answer = json.loads(text)
            if answer.get("id") == self._sent:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def close(self) -> None:
        """Close the ends of the pipes."""
        os.close(self._out)
        self._in.close()

    def open(self, address: str, width: int, height: int) -> None:
        """Open an address in a window of a size and wait until it is loaded."""
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        self.ask("Page.enable")
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.ask("Page.navigate", url=address)
        self.value(
            "new Promise(done => document.readyState === 'complete' ? done() : "
            "addEventListener('load', done))"
        )

    def value(self, script: str) -> Any:
        """Return what a script gives; a promise is awaited."""
        made = self.ask(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in made, made["exceptionDetails"]
        return made["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Press a key and let it go."""
        for kind in ("keyDown", "keyUp"):
            text = {"text": "\r"} if key == "Enter" and kind == "keyDown" else {}
            self.ask(
                "Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **text
            )


@contextmanager
def opened(path: Path, mark: str = "", width: int = 1400, height: int = 900) -> Iterator[Page]:
    """Open a file in a browser of its own.

    Args:
        path: of the page.
        mark: behind its address, such as ``#play``.
        width: of the window [pixels].
        height: of the window [pixels].
    """
    read, out = os.pipe()
    back, write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--remote-debugging-pipe",
            f"--user-data-dir={folder}",
        ]
        command = ["bash", "-c", f'exec "$@" 3<&{read} 4>&{write}', "-", str(BROWSER), *options]
        with subprocess.Popen(
            command, pass_fds=(read, write), stderr=subprocess.DEVNULL
        ) as process:
            os.close(read)
            os.close(write)
            page = Page(out, back)
            try:
                page.open(path.resolve().as_uri() + mark, width, height)
                yield page
            finally:
                process.kill()
                page.close()

"""A shell in an empty folder, with the wheel that an installation unpacks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def installed(folder: Path) -> Path:
    """Build the wheel, install it into a folder without its dependencies, and return the folder."""
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    wheels = folder / "wheels"
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(wheels), str(ROOT)]
    subprocess.run(build, check=True, cwd=folder)
    (wheel,) = wheels.glob("distal-*.whl")
    site = folder / "site"
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(wheel)], check=True)
    return site


class Shell:
    """Runs lines of a shell in one folder; `distal` is the installed wheel's."""

    def __init__(self, folder: Path, site: Path) -> None:
        self.folder = folder
        command = folder / "bin" / "distal"
        command.parent.mkdir()
        # a launcher as pip writes one: only it knows where the package is
        command.write_text(
            f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(site)!r})\n"
            "from distal_command import main\nmain()\n"
        )
        command.chmod(0o755)
        self.environment = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("DISTAL_", "PYTHON", "OMP_", "OPENBLAS_", "MKL_"))
            or name == "DISTAL_CACHE"  # that of the user's home stays as it is
        }
        self.environment["PATH"] = f"{command.parent}{os.pathsep}{os.environ['PATH']}"

    def run(self, lines: str) -> str:
        """Run lines, each of which has to succeed, and return what they print."""
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", lines],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{lines}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
        assert "Traceback" not in done.stderr
        return done.stdout

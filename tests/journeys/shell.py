"""A shell in a folder, with the `distal` of this environment or of an installed wheel."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
HERE = Path(sys.executable).parent


def installed(folder: Path) -> Path:
    """Build the wheel, install it into a folder without its dependencies, and return the folder of
    its command.
    """
    pip = f"{sys.executable} -m pip --quiet --disable-pip-version-check"
    build = f"{pip} wheel --no-deps --no-build-isolation -w wheels {ROOT}"
    ran(f"{build}\n{pip} install --no-deps --target site wheels/distal-*.whl", folder)
    command = folder / "bin" / "distal"
    command.parent.mkdir()
    # a launcher as pip writes one: only it knows where the package is
    command.write_text(
        f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(folder / 'site')!r})\n"
        "from distal_command import main\nmain()\n"
    )
    command.chmod(0o755)
    return command.parent


def environment(commands: Path = HERE) -> dict[str, str]:
    """Return that of a user who has no setting of distal but a cache."""
    set_here = ("DISTAL_", "PYTHON", "OMP_", "OPENBLAS_", "MKL_")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(set_here)}
    path = os.pathsep.join([str(commands), str(HERE), os.environ["PATH"]])
    return {**kept, "DISTAL_CACHE": os.environ["DISTAL_CACHE"], "PATH": path}


def ran(lines: str, folder: Path, commands: Path = HERE) -> subprocess.CompletedProcess[str]:
    """Run lines of a shell; what ends them is an error that a user can mend, in one line."""
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", lines],
        cwd=folder,
        env=environment(commands),
        capture_output=True,
        text=True,
        timeout=600,
    )
    said = done.stdout + done.stderr
    assert "Traceback" not in said, said
    assert "fault of distal" not in said, said
    assert done.returncode in (0, 2), said
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) <= 1 or done.returncode == 0, said
    assert errors or done.returncode == 0, said
    return done

"""MuJoCo models from files, also from those whose meshes are somewhere else."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from distal.errors import RigError


def mujoco_module() -> Any:
    """Return the module `mujoco`.

    Raises:
        RigError: it is not installed.
    """
    try:
        import mujoco
    except ImportError:
        raise RigError("models of MuJoCo need the package 'mujoco': pip install 'distal[mujoco]'") from None
    return mujoco


def load_model(path: str | Path) -> Any:
    """Load a MuJoCo model from an XML file; meshes that are not there are left out, since they only draw it.

    Args:
        path: of the file.

    Raises:
        RigError: the package is missing, or MuJoCo does not take the file.
    """
    mujoco, path = mujoco_module(), Path(path)
    if not path.is_file():
        raise RigError(f"{path}: there is no such file")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except Exception as problem:
        if not re.search(r"opening file|mesh|texture|hfield", str(problem), re.IGNORECASE):
            raise RigError(f"{path}: MuJoCo does not take it: {_one_line(problem)}") from None
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        for geom in list(spec.geoms):
            if geom.type in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD):
                spec.delete(geom)
        for kind in ("materials", "textures", "meshes", "hfields", "skins"):
            for one in list(getattr(spec, kind)):
                spec.delete(one)
        for geom in spec.geoms:
            geom.material = ""
        for site in spec.sites:
            site.material = ""
        for tendon in spec.tendons:
            tendon.material = ""
        return spec.compile()
    except Exception as problem:
        raise RigError(f"{path}: MuJoCo does not take it: {_one_line(problem)}") from None


def _one_line(problem: Exception) -> str:
    return " ".join(str(problem).split())

"""MuJoCo models from files, even where the files of their meshes are missing."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from distal.errors import RigError

if TYPE_CHECKING:
    import mujoco


def mujoco_module() -> ModuleType:
    """Return the module `mujoco`.

    Raises:
        RigError: it is not installed.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise RigError(
            "models of MuJoCo need the package 'mujoco': pip install '.[mujoco]'"
        ) from None


def load_model(path: str | Path) -> mujoco.MjModel:
    """Load a MuJoCo model from an XML file. Where files of meshes are missing, the model is loaded
    without any mesh, since these only draw it.

    Raises:
        RigError: there is no such file, or MuJoCo refuses it.
    """
    package = mujoco_module()
    path = Path(path)
    if not path.is_file():
        raise RigError(f"{path}: there is no such file")
    try:
        return package.MjModel.from_xml_path(str(path))
    except Exception as problem:
        if not re.search(r"opening file|mesh|texture|hfield", str(problem), re.IGNORECASE):
            raise RigError(f"{path}: MuJoCo does not take it: {_one_line(problem)}") from None
    try:
        spec = package.MjSpec.from_file(str(path))
        for geom in list(spec.geoms):
            if geom.type in (
                package.mjtGeom.mjGEOM_MESH,
                package.mjtGeom.mjGEOM_SDF,
                package.mjtGeom.mjGEOM_HFIELD,
            ):
                spec.delete(geom)
        for kind in ("materials", "textures", "meshes", "hfields", "skins"):
            for asset in list(getattr(spec, kind)):
                spec.delete(asset)
        for part in (*spec.geoms, *spec.sites, *spec.tendons):
            part.material = ""
        return spec.compile()
    except Exception as problem:
        raise RigError(f"{path}: MuJoCo does not take it: {_one_line(problem)}") from None


def _one_line(problem: Exception) -> str:
    return " ".join(str(problem).split())

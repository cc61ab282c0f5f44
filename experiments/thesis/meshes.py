"""The meshes of the thesis, where they are at hand."""

import os
from pathlib import Path

from jaxthermo.geometry.load import load_mesh
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import figurine


FILES = {"Happy Buddha": "happy-buddha.obj", "Max Planck": "max-planck.obj"}
HEIGHT = 0.5
"""Of every body [m]."""


def thesis_meshes() -> dict[str, Mesh]:
    """Those in JAXTHERMO_MESHES or ../shared/meshes; without any, the figurine."""
    named = os.environ.get("JAXTHERMO_MESHES", "../shared/meshes")
    folders = [Path(folder) for folder in named.split(os.pathsep) if folder]
    found = {}
    for name, file in FILES.items():
        for folder in folders:
            if name not in found and (folder / file).is_file():
                found[name] = load_mesh(folder / file, height=HEIGHT, up="y")
    return found or {"figurine": figurine(HEIGHT)}

"""`jaxthermo export`: the surfaces of a finished run as files of other programs."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..arrays import precision
from ..atomic import write_json
from ..config.schema.scene import SceneConfig
from ..errors import InputError
from ..geometry.mesh import Pose
from ..image.export.gltf import GltfMesh, linear_colours, write_glb
from ..image.export.textures import BodyTextures, write_textures
from ..image.export.vertex_mesh import VertexMesh, vertex_mesh
from ..image.export.vtu import write_pvd, write_vtu
from ..image.palette import apply_palette
from ..integrate.run.solution_file import StoredSolution, load_solution
from ..report.numbers import count
from ..scene.scene import SURFACE_OUTPUTS, SolvedSurface
from .console import open_console, print_line, status
from .files import frame_names, results_folder
from .frames import chosen_frames, finished_config


# Least range of a colour scale [K].
_MIN_RANGE = 0.1
_UNITS = {"heat_flux": "W_m2", "heat_transfer_coefficient": "W_m2K"}


class _Run(NamedTuple):
    """A finished run, and which of its times are exported."""

    config: SceneConfig
    stored: StoredSolution
    chosen: list[int]
    stems: list[str]
    """Name of the files of every saved time."""

    @property
    def names(self) -> list[str]:
        """Name of every body: its number and what it is."""
        return [f"body{n}_{body.label}" for n, body in enumerate(self.config.bodies)]

    @property
    def rows(self) -> list[slice]:
        """Fragments of every body in arrays of all of them."""
        sizes = [len(s.geometry.fragment_area) for s in self.stored.surfaces]
        ends = np.cumsum([0, *sizes]).tolist()
        return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    def time(self, k: int) -> float:
        """A saved time [s]."""
        return float(self.stored.times[k])

    def pose(self, body: int, k: int) -> Pose:
        """Pose of a body at a saved time."""
        return self.stored.surfaces[body].geometry.pose.at(self.time(k))

    def kelvin(self, k: int) -> Float[np.ndarray, " s"]:
        """Temperatures of all fragments [K]."""
        return np.asarray(self.stored.surface_temperature[k], float)

    def scale(self) -> tuple[float, float]:
        """Ends of the colour scale [K]: of the config, or of what is exported."""
        seen = [self.kelvin(k) for k in self.chosen]
        given = self.config.image
        low = min(s.min() for s in seen) if given.low is None else given.low
        high = max(s.max() for s in seen) if given.high is None else given.high
        return float(low), max(float(high), float(low) + _MIN_RANGE)


def export(
    run: Path, format: str, out: Path | None, overrides: tuple[str, ...]
) -> None:
    """Write the surfaces of a finished run at its saved times.

    Raises:
        InputError: for an unknown format, a folder without a run, or a time that was
            not saved.
    """
    if format not in _WRITERS:
        raise InputError(f"--format {format}: choose {', '.join(_WRITERS)}")
    config = finished_config(run, overrides, find_meshes=False)
    console = open_console()
    with precision(config.dtype), status(console, "exporting"):
        stored = load_solution(run / "solution.npz")
        chosen = chosen_frames(config, stored.times)
        stems = frame_names(np.asarray(stored.times, float).tolist())
        given = _Run(config, stored, chosen, stems)
        with results_folder(out or run / format) as folder:
            written = _WRITERS[format](given, folder)
    print_line(console, f"{count(written, 'file')} in {out or run / format}")


def _write_vtu(run: _Run, folder: Path) -> int:
    meshes = [vertex_mesh(s.geometry) for s in run.stored.surfaces]
    files = []
    for k in run.chosen:
        name = f"surface_{run.stems[k]}.vtu"
        points, faces, values, body = _joined(run, meshes, k)
        arguments = points, faces, values, {"body": body}
        write_vtu(folder / name, *arguments, time=run.time(k))
        files.append((run.time(k), name))
    write_pvd(folder / "surface.pvd", files)
    return len(files) + 1


def _joined(run: _Run, meshes: list[VertexMesh], k: int) -> tuple[Any, ...]:
    """Points in the world, faces, point data and numbers of bodies, of all bodies."""
    poses = [run.pose(n, k) for n in range(len(meshes))]
    pairs = list(zip(meshes, poses, strict=True))
    before = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + n for mesh, n in zip(meshes, before[:-1], strict=True)]
    body = [np.full(len(m.faces), n, np.int32) for n, m in enumerate(meshes)]
    values = {
        name: np.concatenate([mesh.values(part) for mesh, part in each])
        for name, each in _fields(run, meshes, k)
    }
    normals = [pose.rotate(mesh.normals) for mesh, pose in pairs]
    values["Normals"] = np.concatenate(normals).astype(np.float32)
    points = np.concatenate([pose.to_world(mesh.vertices) for mesh, pose in pairs])
    return points, np.concatenate(faces), values, np.concatenate(body)


def _fields(run: _Run, meshes: list[VertexMesh], k: int) -> Iterator[tuple[str, Any]]:
    """Name with unit, and mesh and fragment values of every body."""
    split = lambda values: [np.asarray(values, float)[rows] for rows in run.rows]
    found = {
        "temperature_K": split(run.kelvin(k)),
        "emissivity": [_emissivity(surface) for surface in run.stored.surfaces],
    }
    for name in SURFACE_OUTPUTS:
        given = getattr(run.stored, name)
        if given is not None:
            found[f"{name}_{_UNITS[name]}"] = split(given[k])
    for name, values in found.items():
        yield name, list(zip(meshes, values, strict=True))


def _emissivity(surface: SolvedSurface) -> Float[np.ndarray, " s"]:
    shape = surface.geometry.fragment_area.shape
    return np.broadcast_to(np.asarray(surface.emissivity, float), shape)


def _write_glb(run: _Run, folder: Path) -> int:
    low, high = run.scale()
    palette = run.config.image.palette
    meshes = [vertex_mesh(s.geometry) for s in run.stored.surfaces]
    notes = {"palette": palette, "low_K": low, "high_K": high}
    notes["units"] = "POSITION: m; _TEMPERATURE: K; COLOR_0: linear RGB of the palette"
    for k in run.chosen:
        kelvin, drawn = run.kelvin(k), []
        for n, (mesh, rows) in enumerate(zip(meshes, run.rows, strict=True)):
            values = mesh.values(kelvin[rows])
            colours = apply_palette(values[None], low, high, palette)[0]
            attributes = {
                "POSITION": mesh.vertices,
                "NORMAL": mesh.normals,
                "COLOR_0": linear_colours(colours),
                "_TEMPERATURE": values,
            }
            drawn.append(GltfMesh(run.names[n], run.pose(n, k), mesh.faces, attributes))
        write_glb(
            folder / f"{run.stems[k]}.glb", drawn, {"time_s": run.time(k), **notes}
        )
    return len(run.chosen)


def _write_texture(run: _Run, folder: Path) -> int:
    low, high = run.scale()
    pages, written = [], 0
    for n, surface in enumerate(run.stored.surfaces):
        frames = [(run.stems[k], run.kelvin(k)[run.rows[n]]) for k in run.chosen]
        given = BodyTextures(run.names[n], surface.geometry, low, high)
        page = write_textures(folder, given, frames, run.config.image.palette)
        written += len(page["files"]) + sum(len(f["files"]) for f in page["textures"])
        for k, entry in zip(run.chosen, page["textures"], strict=True):
            pose = run.pose(n, k)
            entry["time_s"] = run.time(k)
            entry["pose"] = {
                "translation_m": list(pose.translation),
                "rotation": [list(row) for row in pose.rotation],
            }
        pages.append(page)
    notes = {
        "units": "16-bit PNG: 0.01 K; EXR: K; heat PNG: 8 bits from low_K to high_K",
        "low_K": low,
        "high_K": high,
        "bodies": pages,
    }
    write_json(folder / "textures.json", notes)
    return written + 1


_WRITERS: dict[str, Callable[[_Run, Path], int]] = {
    "vtu": _write_vtu,
    "glb": _write_glb,
    "texture": _write_texture,
}

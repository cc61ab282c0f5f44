"""Contact textures of a finished run: temperatures where bodies touch, over time."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..arrays import precision
from ..config.schema.scene import SceneConfig
from ..config.types.model import build
from ..console.results_folder import prepare_folder, results_folder
from ..console.terminal import open_console, print_line, status
from ..constants import ZERO_CELSIUS
from ..errors import InputError
from ..image.colour.annotate import write_png
from ..image.colour.ticks import time_label
from ..integrate.run.abstract_solution import StoredSolution
from ..integrate.run.solution_file import load_run
from ..physics.contact.links import Contact
from ..physics.contact.rays import PlacedGrid
from ..physics.contact.search import contacts_between
from ..report.layer_sheets import contact_texture_sheet
from ..report.numbers import count
from ..voxels.abstract_grid import AbstractGrid
from ..voxels.grid import VoxelGrid
from .frame_names import CONTACTS, earlier_frames
from .frames import SavedTime, chosen_frames, finished_config


# Minimum range of the colour scale [K]: a single temperature would have no colours.
_MIN_RANGE = 0.1
_QUANTITY = "surface temperature where bodies touch [\N{DEGREE SIGN}C]"


class _Texture(NamedTuple):
    """Contacts at one saved time, and the temperatures there."""

    time: SavedTime
    area: float
    """Contact area of all pairs of bodies [m^2]."""
    values: list[Float[np.ndarray, " s"]]
    """Surface temperature of each body's fragments [deg C], NaN without contact."""


def render_contacts(run: Path, out: Path | None, overrides: tuple[str, ...]) -> None:
    """`jaxthermo render --contacts`: a sheet of contact textures for each frame.

    Raises:
        InputError: without a finished run, its meshes, a contact term or a contact.
    """
    config = finished_config(run, overrides, find_meshes=True)
    terms = (*build(config.terms), *config.build_joints())
    contacts = [term for term in terms if isinstance(term, Contact)]
    if not contacts:
        raise InputError(
            f"{run}: the scene has no contact term, and so no contact textures"
        )
    console = open_console()
    target = out or run
    with precision(config.dtype):
        stored = load_run(run)
        frame_times = chosen_frames(config, stored.times)
        with status(console, "voxelizing"):
            grids = [body.build_grid() for body in config.bodies]
            _check_unchanged(run, grids, stored)
        thin_walls = [n for n, grid in enumerate(grids) if grid.is_two_sided]
        if len(thin_walls) == len(grids):
            raise InputError(
                f"{run}: contact textures are layers of voxels, and all bodies are "
                "sheets: `jaxthermo export` writes the temperatures of their faces"
            )
        with status(console, "finding contacts"):
            textures = [
                _texture(contacts, grids=grids, stored=stored, time=time)
                for time in frame_times
            ]
        if not any(texture.area for texture in textures):
            raise InputError(f"{run}: no bodies touch at the times of the frames")
        with results_folder(target) as folder:
            _write(config, grids=grids, textures=textures, folder=folder / CONTACTS)
    sheets = count(len(frame_times), "sheet")
    print_line(console, f"{sheets} of contact textures in {target / CONTACTS}")
    for number in thin_walls:
        print_line(
            console,
            f"without body {number}, a sheet: `jaxthermo export` writes the "
            "temperatures of its faces",
        )


def _check_unchanged(
    run: Path, grids: list[AbstractGrid], stored: StoredSolution
) -> None:
    # The same mesh at the same pitch has the same fragments in the same order.
    for body, (grid, surface) in enumerate(zip(grids, stored.surfaces, strict=True)):
        recorded = surface.geometry.fragment_position
        rebuilt = grid.fragment_foot
        if recorded.shape != rebuilt.shape or not np.allclose(recorded, rebuilt):
            raise InputError(
                f"{run}: the mesh of body {body} has changed since the run; "
                "run the simulation again"
            )


def _texture(
    contacts: list[Contact],
    grids: list[AbstractGrid],
    stored: StoredSolution,
    time: SavedTime,
) -> _Texture:
    placed = tuple(
        PlacedGrid(grid, surface.geometry.pose.at(time.seconds), f"body {n}")
        for n, (grid, surface) in enumerate(zip(grids, stored.surfaces, strict=True))
    )
    covered = [np.zeros(len(grid.fragment_area), bool) for grid in grids]
    area = 0.0
    joined = set()
    for term in contacts:
        for (a, b), pairs in contacts_between(placed, term.max_gap).items():
            # The first contact of two bodies counts.
            if term.connects(a, b) and (a, b) not in joined:
                joined.add((a, b))
                area += float(pairs.area.sum())
                covered[a] |= pairs.coverage_a > 0
                covered[b] |= pairs.coverage_b > 0
    ends = np.cumsum([len(flags) for flags in covered])[:-1]
    surface_kelvin = np.asarray(stored.surface_temperature[time.index], float)
    kelvin = np.split(surface_kelvin, ends)
    values = [
        np.where(touched, temperature - ZERO_CELSIUS, np.nan)
        for touched, temperature in zip(covered, kelvin, strict=True)
    ]
    return _Texture(time=time, area=area, values=values)


def _write(
    config: SceneConfig,
    grids: list[AbstractGrid],
    textures: list[_Texture],
    folder: Path,
) -> None:
    # One scale for all times, as for the frames.
    all_values = np.concatenate(
        [values for texture in textures for values in texture.values]
    )
    low = float(np.nanmin(all_values))
    high = float(np.nanmax(all_values))
    spare = max(0.0, _MIN_RANGE - (high - low)) / 2
    earlier = earlier_frames(prepare_folder(folder))
    written = set()
    for texture in textures:
        if not texture.area:
            continue
        title = (
            f"{config.name or 'contact'}, {time_label(texture.time.seconds)}: "
            f"{texture.area * 1e4:.4g} cm^2 in contact"
        )
        bodies = [
            (f"body {n}", grid, values)
            for n, (grid, values) in enumerate(zip(grids, texture.values, strict=True))
            if isinstance(grid, VoxelGrid)
        ]
        image = contact_texture_sheet(
            bodies,
            limits=(low - spare, high + spare),
            quantity=_QUANTITY,
            title=title,
            palette=config.image.palette,
        )
        path = folder / f"{texture.time.name}.png"
        write_png(path, image)
        written.add(path)
    for path in earlier - written:
        path.unlink(missing_ok=True)

"""Figure 5.5: a hot ball on a cool head, its contact and conduction textures."""

import time
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxthermo.geometry.mesh import Mesh, Pose
from jaxthermo.geometry.shapes import sphere
from jaxthermo.image.annotate import write_png
from jaxthermo.image.contact_texture import contact_images, where_covered
from jaxthermo.image.palette import palette_table
from jaxthermo.image.ticks import label
from jaxthermo.physics.contact.links import contact_conductance_of
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import ContactPairs, contact_flux, find_contacts
from jaxthermo.report.numbers import seconds
from jaxthermo.report.sheet import ColourBar, Tile, sheet
from jaxthermo.report.table import Table
from jaxthermo.voxels.voxelize import voxelize


BALL = 0.18
"""Radius of the ball over the height of the body."""
CONDUCTIVITY = 16.0
"""Conductivity of both bodies, stainless steel [W/(m K)]."""
CONDUCTANCE = 1000.0
"""h_c [W/(m^2 K)]."""
DIFFERENCE = 100.0
"""Difference of their temperatures at the start [K]."""
TILE = 280
"""Edge of a picture, about [px]."""


def _ball_on_head(mesh: Mesh, height: int) -> tuple[PlacedGrid, PlacedGrid]:
    """A body, and a ball that touches its highest point from above."""
    tall = float(np.ptp(mesh.bounds[:, 2]))
    pitch = tall / height
    ball = sphere(BALL * tall, 5)
    top = mesh.vertices[mesh.faces].reshape(-1, 3)
    x, y, z = top[top[:, 2].argmax()].tolist()
    rest = Pose((x, y, z - float(ball.bounds[0, 2])))
    return (
        PlacedGrid(voxelize(mesh, pitch), Pose(), "head"),
        PlacedGrid(voxelize(ball, pitch), rest, "ball"),
    )


def balls_on_heads(
    meshes: dict[str, Mesh], height: int, folder: Path
) -> list[dict[str, Any]]:
    """Contacts of a ball with each body, and the time to find them."""
    rows = []
    for name, mesh in meshes.items():
        head, ball = _ball_on_head(mesh, height)
        find_contacts(head, ball)
        start = time.perf_counter()
        pairs = find_contacts(head, ball)
        seconds = time.perf_counter() - start
        file = f"contact_{name.lower().replace(' ', '_')}.png"
        flux = _first_flux(pairs, head, ball)
        write_png(folder / file, _texture_sheet(name, head, ball, pairs, flux))
        rows.append(
            {
                "mesh": name,
                "height_voxels": height,
                "fragments": [len(b.grid.fragment_area) for b in (head, ball)],
                "pairs": pairs.count,
                "area_m2": float(pairs.area.sum()),
                "first_heat_rate_W": float(flux[0] @ head.grid.fragment_area),
                "time_s": seconds,
                "picture": file,
            }
        )
    return rows


def _first_flux(pairs: ContactPairs, head: PlacedGrid, ball: PlacedGrid):
    """Heat flux into every fragment of head and ball at first [W/m^2]."""
    half = [2 * CONDUCTIVITY / b.pitch * pairs.area for b in (head, ball)]
    through = contact_conductance_of(
        jnp.asarray(pairs.area), half[0], half[1], CONDUCTANCE
    )
    rate = np.asarray(through, float) * DIFFERENCE
    return (
        contact_flux(pairs.fragment_a, rate, head.grid.fragment_area),
        contact_flux(pairs.fragment_b, -rate, ball.grid.fragment_area),
    )


def _texture_sheet(name: str, head: PlacedGrid, ball: PlacedGrid, pairs, flux):
    """Conduction textures of both bodies, of the layers that hold any contact."""
    max_flux = max(float(np.abs(each).max()) for each in flux) / 1e3
    tiles = []
    coverages = pairs.coverage_a, pairs.coverage_b
    for body, each, coverage in zip((head, ball), flux, coverages, strict=True):
        values = where_covered(np.abs(each) / 1e3, coverage)
        for key, layers in contact_images(body.grid, values, 0.0, max_flux).items():
            tiles += _tiles(f"{body.name}, {key[0]}", body, values, key, layers)
    bar = ColourBar(
        palette_table("iron"),
        tuple(
            (position, label(position * max_flux, 1)) for position in (0.0, 0.5, 1.0)
        ),
        f"heat flux through the contact at first [kW/m^2], ball {DIFFERENCE:g} K "
        "hotter; grey: no contact",
    )
    title = f"{name} and a ball: {pairs.count} pairs, {pairs.area.sum() * 1e4:.2f} cm^2"
    return sheet(tiles, bar, title)


def _tiles(what: str, body: PlacedGrid, values, key: str, layers) -> list[Tile]:
    """The layers along one axis with a value in them, enlarged to be seen."""
    mine = (body.grid.fragment_axis == "xyz".index(key[0])) & ~np.isnan(values)
    tiles = []
    for number in np.unique(body.grid.fragment_layer[mine, 1]).tolist():
        pixels = layers[number]
        factor = max(1, round(TILE / max(pixels.shape[:2])))
        count = np.count_nonzero(body.grid.fragment_layer[mine, 1] == number)
        large = pixels.repeat(factor, axis=0).repeat(factor, axis=1)
        tiles.append(Tile(large, f"{what} layer {number}", f"{count} in contact"))
    return tiles


def head_table(found: list[dict[str, Any]]) -> Table:
    """Contacts of each body with its ball."""
    rows = [
        [
            row["mesh"],
            str(row["height_voxels"]),
            " + ".join(map(str, row["fragments"])),
            str(row["pairs"]),
            f"{row['area_m2'] * 1e4:.2f} cm^2",
            seconds(row["time_s"]),
        ]
        for row in found
    ]
    columns = ("mesh", "high", "fragments", "pairs", "area", "time")
    return Table(columns, rows, "A ball on a head, thesis figure 5.5")

"""Pictures of the site: `make pictures`, or `python docs/make_pictures.py NAME ...`.

Those of the stages are of the built-in figurine, those of the gallery contact sheets of
shipped scenes; each is reduced to at most 150 kB. `live.webp` is taken by
`docs/make_live_picture.py`, which needs a browser.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import altair as alt
import jax
import jax.numpy as jnp
import numpy as np
from PIL import Image, ImageChops, ImageDraw, ImageOps, ImageSequence

import jaxthermo as jt
from jaxthermo.image.colour.annotate import contact_sheet
from jaxthermo.image.colour.palette import BACKGROUND, apply_palette, palette_table
from jaxthermo.image.colour.ticks import label, nice_ticks
from jaxthermo.report.chart import LogAxis, legend, write_chart
from jaxthermo.report.layer_sheets import write_layer_sheets
from jaxthermo.report.sheet import ColourBar, Tile, sheet
from jaxthermo.report.voxel_sheet import voxel_sheet


ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
MAX_BYTES = 150_000
MAX_WIDTH = 1200
SHEET = "contact_sheet.png"
_PAPER = (255, 255, 255)
_INK = (60, 60, 60)


def write_small(name: str, image: Image.Image) -> None:
    """Write a WebP of at most `MAX_WIDTH` pixels across and `MAX_BYTES`.

    It is in full colour: without loss where that fits, else of the best quality that
    does. An image of several frames becomes an animated one.
    """
    path = PICTURES / f"{name}.webp"
    frames = [_not_too_wide(frame) for frame in ImageSequence.Iterator(image)]
    ways = [{"lossless": True}, *({"quality": q} for q in (95, 90, 85, 80))]
    for way in ways:
        frames[0].save(
            path,
            method=6,
            save_all=len(frames) > 1,
            append_images=frames[1:],
            duration=500,
            loop=0,
            **way,
        )
        if path.stat().st_size <= MAX_BYTES:
            return
    raise SystemExit(f"{name}: more than {MAX_BYTES} bytes: draw it smaller")


def _not_too_wide(frame: Image.Image) -> Image.Image:
    frame = frame.convert("RGB")
    if frame.width <= MAX_WIDTH:
        return frame
    height = round(frame.height * MAX_WIDTH / frame.width)
    return frame.resize((MAX_WIDTH, height), Image.Resampling.LANCZOS)


def _trimmed(image: Image.Image, margin: int = 12) -> Image.Image:
    """The picture without most of the white around it."""
    box = ImageChops.invert(image.convert("L")).getbbox() or (0, 0, *image.size)
    return ImageOps.expand(image.convert("RGB").crop(box), margin, _PAPER)


def _figurine(voxels_high: int) -> jt.VoxelGrid:
    mesh = jt.shapes.figurine(0.3)
    return jt.voxelize(mesh, 0.3 / voxels_high)


def _steel(grid: jt.VoxelGrid) -> jt.Body:
    steel = jt.materials["stainless_steel"]
    return jt.Body(jt.FullVolume(grid), steel, temperature=293.15)


def _camera(width: int, height: int) -> jt.Camera:
    return jt.Camera((0.25, -0.7, 0.2), (0.0, 0.0, 0.15), width=width, height=height)


def mesh() -> Image.Image:
    """The mesh, shaded by the normals that an image has."""
    still = jt.simulate(jt.Scene((_steel(_figurine(160)),)), 0.0)
    image = jt.render(still, _camera(420, 520))
    light = np.array((-0.4, -0.7, 0.6)) / np.linalg.norm((-0.4, -0.7, 0.6))
    shade = 0.25 + 0.75 * np.clip(np.asarray(image.normal) @ light, 0, 1)
    shade = np.where(np.isfinite(np.asarray(image.depth)), shade, 1.0)
    return _trimmed(Image.fromarray((255 * shade).astype(np.uint8)))


def raster() -> Image.Image:
    """Depth layers along x."""
    with tempfile.TemporaryDirectory() as folder:
        sheets = write_layer_sheets(_figurine(100), Path(folder))
        sheet_along_x = next(path for path in sheets if "x" in path.stem.split("_"))
        with Image.open(sheet_along_x) as image:
            return image.convert("RGB")


def voxels() -> Image.Image:
    """The voxels from three sides."""
    return voxel_sheet(_figurine(64))


def _middle(grid: jt.VoxelGrid) -> int:
    """Layer across y with the most solid voxels."""
    return int(np.argmax(np.count_nonzero(grid.solid, axis=(0, 2))))


def _node_slice(structure) -> np.ndarray:
    """Number of the node of each voxel in one layer across y; -1 for none."""
    grid = structure.grid
    nodes = np.full(grid.solid.shape, -2, np.int64)
    nodes[grid.solid] = structure.voxel_node()
    return nodes[:, _middle(grid), :].T[::-1]


def _coloured_nodes(nodes: np.ndarray, scale: int) -> np.ndarray:
    """Colours by node with dark lines between them."""
    colours = 110 + np.random.default_rng(3).integers(0, 130, (nodes.max() + 1, 3))
    large = np.kron(nodes, np.ones((scale, scale), np.int64))
    drawn = np.where(large[..., None] >= 0, colours[np.maximum(large, 0)], 255)
    drawn[large == -1] = 225
    edge = np.zeros(large.shape, bool)
    edge[1:] |= large[1:] != large[:-1]
    edge[:, 1:] |= large[:, 1:] != large[:, :-1]
    drawn[edge] = 70
    return drawn.astype(np.uint8)


def structure() -> Image.Image:
    """Nodes of several structures in one slice."""
    grid = _figurine(80)
    structures = {
        "full volume": jt.FullVolume(grid),
        "single shell": jt.SingleShell(grid),
        "octree": jt.Octree(grid),
        "aggregate x4": jt.Aggregate(grid, factor=4),
        "shell over core": jt.ShellOverCore(grid),
    }
    tiles = [
        _labelled(_coloured_nodes(_node_slice(body_structure), 6), name)
        for name, body_structure in structures.items()
    ]
    return _row(
        [
            _labelled_count(t, body_structure)
            for t, body_structure in zip(tiles, structures.values(), strict=True)
        ]
    )


def _labelled(pixels: np.ndarray, text: str) -> Image.Image:
    image = Image.new("RGB", (pixels.shape[1], pixels.shape[0] + 70), _PAPER)
    image.paste(Image.fromarray(pixels))
    at = (pixels.shape[1] / 2, pixels.shape[0] + 8)
    ImageDraw.Draw(image).text(at, text, fill=_INK, anchor="ma", font_size=28)
    return image


def _labelled_count(image: Image.Image, body_structure) -> Image.Image:
    at = (image.width / 2, image.height - 26)
    text = f"{body_structure.node_count:,} nodes".replace(",", " ")
    ImageDraw.Draw(image).text(at, text, fill=_INK, anchor="ma", font_size=22)
    return image


def _row(tiles: list[Image.Image]) -> Image.Image:
    joined = Image.new("RGB", (sum(t.width for t in tiles), tiles[0].height), _PAPER)
    left = 0
    for tile in tiles:
        joined.paste(tile, (left, 0))
        left += tile.width
    return joined


def network() -> Image.Image:
    """Nodes and links of an octree near one layer across y."""
    octree = jt.Octree(_figurine(90))
    grid = octree.grid
    nodes = octree.nodes()
    links = octree.links()
    scale = 16
    layer = _middle(grid)
    pixels = _coloured_nodes(_node_slice(octree), scale)
    image = Image.fromarray((255 - (255 - pixels.astype(int)) // 4).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    layer_nodes = np.unique(_node_slice(octree))
    centres = grid.lattice.centres(np.array([[0, layer, 0]]))[0]
    across = (nodes.location - centres) / grid.pitch + 0.5
    at = np.stack([across[:, 0], grid.solid.shape[2] - across[:, 2]], 1) * scale
    seen = np.isin(np.arange(len(at)), layer_nodes)
    for source, target in zip(links.src, links.dst, strict=True):
        if seen[source] and seen[target]:
            draw.line((*at[source], *at[target]), fill=(150, 70, 40), width=2)
    for x, y in at[seen]:
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), fill=(30, 60, 110))
    # The base, where the body is thick enough for cells of several sizes.
    top = round(0.68 * image.height)
    return _trimmed(image.crop((0, top, image.width, image.height)))


def physics() -> Image.Image:
    """Net heat flux through the surface after a minute in the sun."""
    painted = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.95)
    body = jt.Body(jt.FullVolume(_figurine(160)), painted, temperature=293.15)
    scene = jt.Scene(
        (body,),
        (
            jt.Sun((-0.55, 0.6, -0.75), 1000.0),
            jt.Convection(10.0, 293.15),
            jt.Surroundings(283.0),
        ),
        surface_outputs=("heat_flux",),
    )
    run = jt.simulate(scene, 60.0)
    flux = np.asarray(run.heat_flux)
    # An image interpolates temperatures: it does the same with any positive number.
    shifted = replace(run, surface_temperature=jnp.asarray(flux + 2000.0))
    camera = jt.Camera((0.15, -0.66, 0.22), (0.0, 0.0, 0.15), width=420, height=520)
    image = jt.render(shifted, camera, band=None)
    drawn = np.asarray(image.temperature) - 2000.0
    inside = np.isfinite(np.asarray(image.depth))
    low = -100.0
    high = 900.0
    pixels = apply_palette(drawn, low=low, high=high, name="ember")
    pixels = np.where(inside[..., None], pixels, BACKGROUND).astype(np.uint8)
    ticks = tuple(
        ((t - low) / (high - low), label(t, 0)) for t in nice_ticks(low, high)
    )
    bar = ColourBar(palette_table("ember"), ticks, "heat flux into the body [W/m^2]")
    return sheet([Tile(pixels, "")], bar, "after one minute in the sun", 1)


def _steps_of(name: str, scene: jt.Scene, truth: np.ndarray) -> Iterator[dict]:
    """Errors in time of one scheme, over the number of its steps."""
    scheme = getattr(jt, name)
    for steps in (6, 12, 24, 48, 96, 192):
        try:
            run = jt.simulate(scene, 60.0, solver=scheme(60.0 / steps))
        except jt.InputError:
            continue  # A step above the stable one.
        error = np.abs(np.asarray(run.surface_temperature) - truth).max()
        yield {"scheme": name, "steps": steps, "error": float(error)}


def time() -> Image.Image:
    """Error in time of four schemes over the number of steps."""
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.02)), 2e-3)
    body = jt.Body(jt.FullVolume(grid), jt.materials["glass"], temperature=293.15)
    sun = jt.Sun((0.0, 0.0, -1.0), jt.Table([0.0, 60.0], [0.0, 1000.0]))
    scene = jt.Scene((body,), (sun, jt.Convection(500.0, 293.15)), dtype="float64")
    names = ("ForwardEuler", "SuperTimeStepping", "BackwardEuler", "TRBDF2")
    with jax.enable_x64(True):
        exact = jt.simulate(scene, 60.0, solver=jt.SuperTimeStepping(60.0 / 3000))
        truth = np.asarray(exact.surface_temperature)
        rows = [row for name in names for row in _steps_of(name, scene, truth)]
    steps = LogAxis([row["steps"] for row in rows], "steps in 60 s")
    errors = LogAxis([row["error"] for row in rows], "largest error in time [K]")
    powers = alt.Axis(values=errors.ticks, format=".0e")
    chart = (
        alt.Chart(alt.Data(values=rows), width=420, height=260)
        .mark_line(point=True)
        .encode(
            x=alt.X(**steps.channel("steps")),
            y=alt.Y(**{**errors.channel("error"), "axis": powers}),
            color=alt.Color("scheme:N", sort=list(names), legend=legend()),
        )
    )
    with tempfile.TemporaryDirectory() as folder:
        write_chart(chart, Path(folder) / "time.png")
        with Image.open(Path(folder) / "time.png") as image:
            return image.convert("RGB")


def _simulated(scene: str, *options: str) -> Path:
    folder = Path(tempfile.mkdtemp())
    config = ROOT / "configs" / "scenes" / f"{scene}.yaml"
    # In a process of its own: a command ends the process that it runs in.
    command = [sys.executable, "-m", "jaxthermo", "simulate", str(config)]
    subprocess.run([*command, "--out", str(folder), *options], cwd=ROOT, check=True)
    return folder


def demo() -> Image.Image:
    """Frames of the built-in figurine in sun and shade."""
    folder = _simulated(
        "figurine", "--set", "camera.width=300", "--set", "camera.height=420"
    )
    frames = sorted((folder / "frames").glob("*.png"))
    return contact_sheet([Image.open(path) for path in frames], columns=3)


def image() -> Image.Image:
    """One frame of the figurine."""
    folder = _simulated(
        "figurine", "--set", "camera.width=420", "--set", "camera.height=520"
    )
    frames = sorted((folder / "frames").glob("*.png"))
    return Image.open(frames[2])


def _sheet(scene: str, width: int = 300, height: int = 400) -> Image.Image:
    size = (f"camera.width={width}", f"camera.height={height}")
    options = [word for change in size for word in ("--set", change)]
    folder = _simulated(scene, *options, "--contact-sheet")
    return Image.open(folder / SHEET)


@cache
def _street() -> Path:
    return _simulated("street")


def _rendered(run: Path, *options: str) -> Path:
    folder = Path(tempfile.mkdtemp())
    command = [sys.executable, "-m", "jaxthermo", "render", str(run)]
    subprocess.run([*command, "--out", str(folder), *options], cwd=ROOT, check=True)
    return folder


def street() -> Image.Image:
    """The street at half past four, before sunset, after it and at ten."""
    times = ("--set", "image.frames=[5400, 12600, 18000, 25200]")
    return Image.open(_rendered(_street(), *times, "--contact-sheet") / SHEET)


def evening() -> Image.Image:
    """The street at all saved times, as an animation."""
    size = ("--set", "camera.width=320", "--set", "camera.height=200")
    return Image.open(_rendered(_street(), *size, "--animate") / "animation.png")


MAKERS: dict[str, Callable[[], Image.Image]] = {
    "demo": demo,
    "mesh": mesh,
    "raster": raster,
    "voxels": voxels,
    "structure": structure,
    "network": network,
    "physics": physics,
    "time": time,
    "image": image,
    "van": lambda: _sheet("van", width=400, height=300),
    "street": street,
    "evening": evening,
    "windy": lambda: _sheet("windy"),
    "contact": lambda: _sheet("ball-on-figurine"),
    "day": lambda: _sheet("figurine-day"),
}


def main(names: list[str]) -> None:
    """Draw the named pictures, or all."""
    for name in names or MAKERS:
        write_small(name, MAKERS[name]())
        size = (PICTURES / f"{name}.webp").stat().st_size
        sys.stdout.write(f"{name}: {size / 1000:.0f} kB\n")


if __name__ == "__main__":
    main(sys.argv[1:])

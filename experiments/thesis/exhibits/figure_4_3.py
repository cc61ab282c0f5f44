"""Figure 4.3: the depth layers of the Happy Buddha along three axes."""

import numpy as np
from PIL import Image

from jaxthermo.image.ticks import label, nice_ticks
from jaxthermo.report.sheet import ColourBar, Legend, Tile, sheet
from jaxthermo.voxels.textures import depth_colours, layer_images, normal_colours

from ..bodies import AXES, buddha
from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..layers import count_by_height, count_table, deep_fraction, layer_counts, shown


_HEIGHT = 250
_QUICK_HEIGHTS = (50, 100, 150, 200, 250)
_HEIGHTS = (*_QUICK_HEIGHTS, 350, 450, 550)
_THESIS = (18, 20, 8)
_MAX_COLUMNS = 10


def _depth_picture(images: dict, grid) -> Image.Image:
    """The first three depth textures of the thesis' z axis."""
    tiles = [
        Tile(pixels.repeat(2, axis=0).repeat(2, axis=1), f"z layer {k + 1}")
        for k, pixels in enumerate(images["y_depth"][:3])
    ]
    whole = 1e3 * grid.pitch * grid.lattice.shape[AXES["z"]]
    ticks = nice_ticks(0.0, whole)
    bar = ColourBar(
        depth_colours(np.linspace(0.0, 1.0, 256)),
        tuple((tick / whole, label(tick, 0)) for tick in ticks),
        "depth along z from the front [mm]; dark: no surface",
    )
    return sheet(tiles, bar, "Depth in the first three textures of the z axis")


def _axis_picture(images: dict, name: str) -> Image.Image:
    """Every texture of one axis, coloured by the normal."""
    tiles = [
        Tile(pixels, f"{name} {k + 1}")
        for k, pixels in enumerate(images[f"{'xyz'[AXES[name]]}_normal"])
    ]
    ways = np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
    names = ("+x", "-x", "-z", "+z", "+y", "-y")
    colours = [(int(r), int(g), int(b)) for r, g, b in normal_colours(ways)]
    legend = Legend(
        tuple(zip(names, colours, strict=True)), "direction of the outward normal"
    )
    title = f"{len(tiles)} textures along {name}, front layer first"
    rows = -(-len(tiles) // _MAX_COLUMNS)
    return sheet(tiles, legend, title, columns=-(-len(tiles) // rows))


def _measure(quick: bool) -> Finding:
    statue = buddha()
    grid = statue.grid(_HEIGHT, "dominant_axis")
    images, (peeled, _) = layer_images(grid), layer_counts(grid)
    by_height = count_by_height(statue, _QUICK_HEIGHTS if quick else _HEIGHTS)
    counts = dict(zip("xyz", peeled, strict=True))
    last = {name: deep_fraction(grid, name, n - 4) for name, n in counts.items()}
    same = sum(a == b for a, b in zip(peeled, _THESIS, strict=True))
    reason = (
        f"{shown(peeled)} layers along x/y/z at {_HEIGHT} voxels, the thesis has "
        f"{shown(_THESIS)}: {same} of 3 are equal. The numbers follow the finest "
        "folds: the last four layers hold "
        + ", ".join(f"{part:.2%} of {name}'s" for name, part in last.items())
        + " texels, and they change with resolution and with the decimation of the "
        "scan; the thesis states neither of the two here."
    )
    rows = tuple(
        Row(f"layers along {name}", said, ours)
        for name, said, ours in zip("xyz", _THESIS, peeled, strict=True)
    )
    chosen = (
        *statue.stands_in,
        ("resolution", f"{_HEIGHT} voxels high, the 100x250x100 of 6.1; not given"),
        ("axes", "y up, z towards the front of the figure, as the thesis has them"),
    )
    parts = (
        Picture(
            "figure-4.3-depth",
            _depth_picture(images, grid),
            "As on the left of the figure: depth in the first three textures of the z "
            "axis.",
        ),
        *(
            Picture(
                f"figure-4.3-{name}",
                _axis_picture(images, name),
                f"All textures along {name}, coloured by the normal.",
            )
            for name in AXES
        ),
        count_table(by_height),
    )
    verdict = Verdict.REPRODUCED if peeled == _THESIS else Verdict.DIFFERENT
    numbers = {"thesis": list(_THESIS), "ours": list(peeled), "by_height": by_height}
    return Finding(verdict, reason, rows, {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="figure-4.3",
    title="voxelized textures of the Happy Buddha",
    place="4.1, figure 4.3",
    claims=(),
    measure=_measure,
)

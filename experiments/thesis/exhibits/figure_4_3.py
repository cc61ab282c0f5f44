"""Figure 4.3: the depth layers of the Happy Buddha along three axes."""

from PIL import Image

from jaxthermo.report.layer_sheets import depth_bar, normal_legend
from jaxthermo.report.sheet import Tile, sheet
from jaxthermo.voxels.textures import layer_images

from ..bodies import AXES, WAYS, buddha
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
    bar = depth_bar(grid, "xyz"[AXES["z"]], "depth along z from the front")
    return sheet(tiles, bar, "Depth in the first three textures of the z axis")


def _axis_picture(images: dict, name: str) -> Image.Image:
    """Every texture of one axis, coloured by the normal."""
    tiles = [
        Tile(pixels, f"{name} {k + 1}")
        for k, pixels in enumerate(images[f"{'xyz'[AXES[name]]}_normal"])
    ]
    legend = normal_legend("direction of the outward normal", WAYS)
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

"""Figure 4.6: original, stored and packed textures of the Happy Buddha along z."""

import numpy as np
from PIL import Image

import jaxthermo as jt
from jaxthermo.report.layer_sheets import normal_legend
from jaxthermo.report.sheet import Tile, sheet
from jaxthermo.voxels.lattice import peel_axes
from jaxthermo.voxels.surface import face_axes
from jaxthermo.voxels.textures import AXIS_COLOURS, layer_images

from ..bodies import AXES, WAYS, buddha
from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..layers import judged, layer_counts, shown, storage, storage_rows


_HEIGHT = 250
_PEELED, _PACKED = (18, 20, 8), (8, 11, 6)


def _picture(grid: jt.VoxelGrid) -> Image.Image:
    axis = AXES["z"]
    name = "xyz"[axis]
    images = layer_images(grid)
    original, packed = images[f"{name}_normal"], images[f"{name}_packed"]
    on_axis = [
        (dominant == AXIS_COLOURS[axis]).all(axis=-1)
        for dominant in images[f"{name}_dominant"]
    ]
    dark = original[0][0, 0]
    stored = [
        np.where(keep[..., None], pixels, dark)
        for keep, pixels in zip(on_axis, original, strict=True)
    ]
    empty = np.full_like(original[0], 64)
    packed = packed + [empty] * (len(original) - len(packed))
    tiles = [
        Tile(pixels, f"({letter}) {k + 1}" if pixels is not empty else "removed")
        for letter, row in (("a", original), ("b", stored), ("c", packed))
        for k, pixels in enumerate(row)
    ]
    legend = normal_legend("direction of the outward normal; dark: no surface", WAYS)
    title = "Textures along z: (a) original, (b) stored, (c) packed"
    return sheet(tiles, legend, title, columns=len(original))


def _stored_layers(grid: jt.VoxelGrid) -> list[int]:
    """Layers with any texel left along the thesis' x, y, z, before packing."""
    found = []
    for axis in AXES.values():
        layers = peel_axes(grid.mesh, grid.lattice)[axis]
        _, dominant = face_axes(grid.mesh)
        found.append(len(np.unique(layers.layer[dominant[layers.triangle] == axis])))
    return found


def _measure(_: bool) -> Finding:
    statue = buddha()
    grid = statue.grid(_HEIGHT, "dominant_axis")
    peeled, packed = layer_counts(grid)
    stored, found = _stored_layers(grid), storage(grid)
    ratio, theirs = sum(packed) / sum(peeled), sum(_PACKED) / sum(_PEELED)
    halves = abs(ratio - 0.5) <= 0.1
    reason = (
        f"{sum(peeled)} layers become {sum(packed)}, {ratio:.2f} of them; the thesis "
        f"has {sum(_PEELED)} and {sum(_PACKED)}, {theirs:.2f}, and calls it a half. "
        f"Packed along x/y/z: {shown(packed)} for the thesis' {shown(_PACKED)}."
    )
    own = Verdict.REPRODUCED if halves else Verdict.CONTRADICTED
    rows = (
        *(
            Row(f"layers along {name} after packing", said, ours)
            for name, said, ours in zip("xyz", _PACKED, packed, strict=True)
        ),
        Row("layers before packing, x/y/z", shown(_PEELED), shown(peeled)),
        Row("of which still hold a texel", None, "/".join(map(str, stored))),
        Row("layers after over before packing", theirs, ratio),
        *storage_rows(found),
    )
    caption = (
        "From left to right the layers from the front; rows: (a) as peeled, (b) where "
        "z is the normal's largest component, (c) moved to the first free layer."
    )
    chosen = (
        *statue.stands_in,
        ("resolution", f"{_HEIGHT} voxels high, the 100x250x100 of 6.1; not given"),
    )
    return Finding(
        Verdict.REPRODUCED if halves and packed == _PACKED else Verdict.DIFFERENT,
        reason,
        rows,
        {"C09": judged(statue.name, found), "C10": (own, reason)},
        chosen,
        (Picture("figure-4.6", _picture(grid), caption),),
        {
            "peeled": list(peeled),
            "packed": list(packed),
            "ratio": ratio,
            "ratio_thesis": theirs,
            **found,
        },
    )


EXHIBIT = Exhibit(
    name="figure-4.6",
    title="textures before and after packing",
    place="4.2, figure 4.6",
    claims=("C09", "C10"),
    measure=_measure,
)

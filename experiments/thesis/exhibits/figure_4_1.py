"""Figure 4.1: a mesh and its slices at two voxel sizes, beside depth peeling."""

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import figurine
from jaxthermo.image.colour.preview import draw_preview
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.report.sheet import Legend, Tile, sheet
from jaxthermo.report.voxel_sheet import voxel_view
from jaxthermo.voxels.lattice import peel_axes, pixel_axes

from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..slicing import slice_voxels


# Of the body [m]; voxels along it.
_HEIGHT, _LARGE, _SMALL = 0.5, 16, 48
_EDGE = 460
_VIEW = (-0.35, 1.0, -0.25)


def _compare(grid: jt.VoxelGrid) -> dict[str, float | int | bool]:
    """Rendering passes, texels and voxels of both methods, along all three axes."""
    shape, slices, texels = grid.lattice.shape, 0, 0
    found = {"slice_passes": 0, "peel_passes": 0, "occupied": 0}
    same: bool = True
    corners = grid.lattice.to_cells(grid.mesh.triangles)
    for axis, layers in enumerate(peel_axes(grid.mesh, grid.lattice)):
        row_axis, column_axis = pixel_axes(axis)
        height, width, depth = shape[row_axis], shape[column_axis], shape[axis]
        seen = np.ascontiguousarray(corners[..., [column_axis, row_axis, axis]])
        sliced = slice_voxels(seen[_may_cover(seen)], width, height, depth)
        row, column = np.divmod(layers.pixel, width)
        slab = np.floor(layers.depth).astype(int)
        peeled = set(zip(column.tolist(), row.tolist(), slab.tolist(), strict=True))
        same = same and sliced == peeled
        found["slice_passes"] += depth
        # One more, in which nothing is drawn, ends the peeling.
        found["peel_passes"] += layers.count + 1
        found["occupied"] += len(sliced)
        slices += depth * width * height
        texels += layers.count * width * height
    return {
        **found,
        "slice_texels": slices,
        "peel_texels": texels,
        "occupied_of_slices": found["occupied"] / slices,
        "occupied_of_layers": found["occupied"] / texels,
        "same_voxels": same,
    }


def _may_cover(triangles: np.ndarray) -> np.ndarray:
    """Flag triangles whose box holds the centre of a pixel: few, of a fine mesh."""
    low, high = (end(triangles[..., :2], axis=1) for end in (np.min, np.max))
    # A little wider, since the slices round corners to parts of a pixel.
    first, last = np.ceil(low - 0.51), np.floor(high - 0.49)
    return np.all(first <= last, axis=1)


def _measure(_: bool) -> Finding:
    mesh = figurine(_HEIGHT)
    camera = frame_all(mesh.triangles, _EDGE, _EDGE, _VIEW)
    body = draw_preview([(mesh, Pose())], camera)[0]
    tiles = [Tile(np.asarray(body)[:_EDGE], "mesh", f"{len(mesh.faces):,} triangles")]
    numbers = {}
    for name, high in (("large voxels", _LARGE), ("small voxels", _SMALL)):
        grid = jt.voxelize(mesh, _HEIGHT / high)
        numbers[name] = _compare(grid)
        note = f"{high} high, {grid.solid_count:,} solid"
        tiles.append(Tile(voxel_view(grid, camera), name, note))
    legend = Legend(
        (("solid voxel", (196, 198, 200)), ("under a voxel thick", (244, 152, 32))),
        "orange: the body is thinner than a voxel there",
    )
    title = "From left to right: mesh, large and small voxels"
    picture = sheet(tiles, legend, title, columns=3)
    same = all(each["same_voxels"] for each in numbers.values())
    fine = numbers["small voxels"]
    verdict = Verdict.REPRODUCED if same else Verdict.CONTRADICTED
    reason = (
        ("Slicing and depth peeling find the same voxels" if same else "They differ")
        + f" at both sizes. At {_SMALL} voxels slicing takes {fine['slice_passes']} "
        f"passes and peeling {fine['peel_passes']}; {fine['occupied_of_slices']:.1%} "
        f"of the slices' texels are occupied and {fine['occupied_of_layers']:.0%} of "
        "the layers': the boundary is a small part of a slice, as the thesis says."
    )
    shown = lambda value: f"{value:.1%}" if isinstance(value, float) else value
    rows = [
        Row(f"{what}, {name}", said, shown(each[key]))
        for name, each in numbers.items()
        for what, said, key in (
            ("passes of slicing, three axes", None, "slice_passes"),
            ("passes of peeling, three axes", None, "peel_passes"),
            ("occupied texels of all slices", "a small part", "occupied_of_slices"),
            ("occupied texels of all layers", None, "occupied_of_layers"),
        )
    ]
    chosen = (("mesh", "the built-in figurine in place of the penguin"),)
    caption = (
        "The figurine as a mesh, and in voxels of two sizes: smaller ones follow the "
        "shape more closely and take more storage."
    )
    parts = (Picture("figure-4.1", picture, caption),)
    return Finding(
        verdict, reason, tuple(rows), chosen=chosen, parts=parts, numbers=numbers
    )


EXHIBIT = Exhibit(
    name="figure-4.1",
    title="slicing beside depth peeling",
    place="4.1, figure 4.1",
    claims=(),
    measure=_measure,
)

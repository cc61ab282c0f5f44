"""Chapter 4 and 6.3: depth layers of bodies, and how often a surface is stored."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int, UInt8
from PIL import Image

import jaxthermo as jt
from jaxthermo.geometry.shapes import figurine
from jaxthermo.image.colour.preview import draw_preview
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.image.surface.visible import WorldMesh
from jaxthermo.raster.fragments import DepthLayers
from jaxthermo.report.layer_sheets import depth_bar, normal_legend
from jaxthermo.report.sheet import Legend, Tile, enlarged, sheet
from jaxthermo.report.voxel_sheet import voxel_view
from jaxthermo.voxels.lattice import peel_axes, pixel_axes
from jaxthermo.voxels.surface import face_axes, surface_voxels
from jaxthermo.voxels.textures import AXIS_COLOURS, layer_images

from ..bodies import AXES, WAYS, Statue, buddha, planck, sphere_grid
from ..exhibit import Finding, Numbers, Verdict, exhibit, judged
from ..slicing import slice_voxels


_HEIGHT = 250
"""Voxels along up: the 100x250x100 of 6.1, since chapter 4 gives no number."""
_QUICK_HEIGHTS = (50, 100, 150, 200, 250)
_HEIGHTS = (*_QUICK_HEIGHTS, 350, 450, 550)
# Layers along the thesis' x, y and z: figures 4.3 and 4.6, and section 6.3.
_PEELED = (18, 20, 8)
_PACKED = (8, 11, 6)
_BUDDHA_6_3 = (8, 14, 8)
_PLANCK_6_3 = (4, 5, 4)
# Height of the figurine [m]; voxels across the sphere.
_TALL = 0.5
_ACROSS = 96
# Largest error of the area, and fraction of voxels that may be stored twice [-].
_MAX_AREA_ERROR = 0.02
_MAX_STORED_TWICE = 0.1

_Layers = tuple[int, int, int]


@exhibit("figure-4.1", "4.1, figure 4.1")
def _slices_and_peeling(_: bool) -> Finding:
    """Slice a mesh at two voxel sizes, and compare with depth peeling."""
    mesh = figurine(_TALL)
    camera = frame_all(mesh.triangles, 460, 460, (-0.35, 1.0, -0.25))
    body = draw_preview([WorldMesh(mesh.vertices, mesh.faces)], camera)[0]
    tiles = [Tile(np.asarray(body)[:460], "mesh", f"{len(mesh.faces):,} triangles")]
    numbers: dict[str, dict[str, float | bool]] = {}
    for name, height in (("large voxels", 16), ("small voxels", 48)):
        grid = jt.voxelize(mesh, _TALL / height)
        numbers[name] = _compare_peeling(grid)
        note = f"{height} high, {grid.solid_count:,} solid"
        tiles.append(Tile(voxel_view(grid, camera), name, note))
    legend = Legend(
        (("solid voxel", (196, 198, 200)), ("under a voxel thick", (244, 152, 32))),
        "orange: the body is thinner than a voxel there",
    )
    title = "From left to right: mesh, large and small voxels"
    is_same = all(row["same_voxels"] for row in numbers.values())
    return Finding(
        judged(is_same),
        {**numbers, "is_same": is_same},
        {"figure-4.1": sheet(tiles, legend, title, columns=3)},
    )


def _compare_peeling(grid: jt.VoxelGrid) -> dict[str, float | bool]:
    """Rendering passes, texels and voxels of both methods, along all three axes."""
    shape = grid.lattice.shape
    corners = grid.lattice.to_cells(grid.mesh.triangles)
    slice_passes = peel_passes = occupied = slice_texels = peel_texels = 0
    same_voxels = True
    for axis, layers in enumerate(peel_axes(grid.mesh, grid.lattice)):
        row_axis, column_axis = pixel_axes(axis)
        height, width, depth = shape[row_axis], shape[column_axis], shape[axis]
        seen = np.ascontiguousarray(corners[..., [column_axis, row_axis, axis]])
        sliced = slice_voxels(seen[_may_cover(seen)], width, height, depth)
        cells = _cells(layers, axis)[:, [column_axis, row_axis, axis]]
        peeled = {tuple(cell) for cell in cells.tolist()}
        same_voxels = same_voxels and sliced == peeled
        slice_passes += depth
        # One more, in which nothing is drawn, ends the peeling.
        peel_passes += layers.count + 1
        occupied += len(sliced)
        slice_texels += depth * width * height
        peel_texels += layers.count * width * height
    return {
        "slice_passes": slice_passes,
        "peel_passes": peel_passes,
        "occupied": occupied,
        "slice_texels": slice_texels,
        "peel_texels": peel_texels,
        "occupied_of_slices": occupied / slice_texels,
        "occupied_of_layers": occupied / peel_texels,
        "same_voxels": same_voxels,
    }


def _cells(layers: DepthLayers, axis: int) -> Int[np.ndarray, "n 3"]:
    """Cells of the lattice that the layers along an axis cross."""
    row_axis, column_axis = pixel_axes(axis)
    cells = np.zeros((len(layers.pixel), 3), np.int64)
    rows, columns = np.divmod(layers.pixel, layers.width)
    cells[:, row_axis] = rows
    cells[:, column_axis] = columns
    cells[:, axis] = np.floor(layers.depth)
    return cells


def _may_cover(triangles: np.ndarray) -> np.ndarray:
    """Flag triangles whose box holds the centre of a pixel: few, of a fine mesh."""
    low = np.min(triangles[..., :2], axis=1)
    high = np.max(triangles[..., :2], axis=1)
    # A little wider, since the slices round corners to fractions of a pixel.
    first = np.ceil(low - 0.51)
    last = np.floor(high - 0.49)
    return np.all(first <= last, axis=1)


@exhibit("figure-4.3", "4.1, figure 4.3")
def _voxelized_textures(quick: bool) -> Finding:
    """Peel the Happy Buddha along three axes."""
    statue = buddha()
    grid = statue.grid(_HEIGHT, "dominant_axis")
    images = layer_images(grid)
    peeled, _ = _layer_counts(grid)
    depth_tiles = [
        Tile(enlarged(pixels, 2 * len(pixels)), f"z layer {number + 1}")
        for number, pixels in enumerate(images["y_depth"][:3])
    ]
    title = "Depth in the first three textures of the z axis"
    bar = depth_bar(grid, "xyz"[AXES["z"]], "depth along z from the front")
    pictures = {"figure-4.3-depth": sheet(depth_tiles, bar, title)}
    for name in AXES:
        pictures[f"figure-4.3-{name}"] = _normal_textures(images, name)
    return Finding(
        judged(peeled == _PEELED, different=True),
        {
            "mesh": statue.name,
            "thesis": _PEELED,
            "ours": peeled,
            "equal": sum(a == b for a, b in zip(peeled, _PEELED, strict=True)),
            "in_last_four": {
                name: _fraction_beyond(grid, name, count - 4)
                for name, count in zip("xyz", peeled, strict=True)
            },
            "by_height": _layers_by_height(
                statue, _QUICK_HEIGHTS if quick else _HEIGHTS
            ),
        },
        pictures,
    )


def _normal_textures(images: Mapping[str, Sequence[np.ndarray]], name: str):
    """Every texture of one of the thesis' axes, coloured by the normal."""
    textures = images[f"{'xyz'[AXES[name]]}_normal"]
    tiles = [Tile(pixels, f"{name} {k + 1}") for k, pixels in enumerate(textures)]
    legend = normal_legend("direction of the outward normal", WAYS)
    title = f"{len(tiles)} textures along {name}, front layer first"
    rows = math.ceil(len(tiles) / 10)
    return sheet(tiles, legend, title, columns=math.ceil(len(tiles) / rows))


def _layer_counts(grid: jt.VoxelGrid) -> tuple[_Layers, _Layers]:
    """Layers along the thesis' x, y, z: as peeled, and stored once and packed."""
    x, y, z = AXES.values()
    peeled = grid.layers.peeled
    packed = grid.layers.packed
    return (
        (peeled[x], peeled[y], peeled[z]),
        (packed[x], packed[y], packed[z]),
    )


def _layer_numbers(peeled: _Layers, packed: _Layers) -> Numbers:
    return {"peeled": peeled, "packed": packed, "sums": [sum(peeled), sum(packed)]}


def _fraction_beyond(grid: jt.VoxelGrid, axis: str, layer: int) -> float:
    """Fraction of the fragments of a view in this layer and those behind it [-]."""
    layers = peel_axes(grid.mesh, grid.lattice)[AXES[axis]]
    return float(np.mean(layers.layer >= layer))


def _layers_by_height(statue: Statue, heights: Sequence[int]) -> list[Numbers]:
    rows: list[Numbers] = []
    for height in heights:
        grid = statue.grid(height, "dominant_axis")
        peeled, packed = _layer_counts(grid)
        x, y, z = (grid.lattice.shape[axis] for axis in AXES.values())
        rows.append(
            {
                "mesh": statue.name,
                "lattice": f"{x} x {y} x {z}",
                "peeled": list(peeled),
                "packed": list(packed),
                "packed_over_peeled": sum(packed) / sum(peeled),
            }
        )
    return rows


@exhibit("figure-4.4", "4.2, figure 4.4")
def _two_views_of_a_sphere(_: bool) -> Finding:
    """Find the part of a sphere that its first layers along x and z both show."""
    grid = sphere_grid(_ACROSS)
    normals, _axes = face_axes(grid.mesh)
    single = (200, 202, 206)
    shared = (226, 120, 40)
    colours = np.array([single, shared], np.uint8)
    tiles = []
    fractions = []
    for name, axis, second_axis in (("x", 0, 2), ("z", 2, 0)):
        layers = peel_axes(grid.mesh, grid.lattice)[axis]
        # The first layer of a ball along an axis is where the normal is against it.
        is_shared = (normals[layers.triangle][:, second_axis] < 0).astype(int)
        background = np.array((32, 34, 40), np.uint8)
        image = layers.image(0, colours[is_shared], background)[::-1, ::-1]
        fractions.append(float(is_shared[layers.layer == 0].mean()))
        note = f"{fractions[-1]:.1%} is shared"
        tiles.append(Tile(enlarged(image, 300), f"first layer along {name}", note))
    legend = Legend((("only in this view", single), ("in both views", shared)))
    title = "First layers of a sphere along x and z"
    is_half = max(abs(fraction - 0.5) for fraction in fractions) < 0.02
    return Finding(
        judged(is_half),
        {"shared": fractions, "exact": 0.5},
        {"figure-4.4": sheet(tiles, legend, title)},
    )


@exhibit("figure-4.5", "4.2, figure 4.5")
def _largest_component(_: bool) -> Finding:
    """Store each texel of a sphere along the axis of its largest normal component."""
    grid = sphere_grid(_ACROSS, subdivisions=6)
    images = layer_images(grid)
    dominant = images["x_dominant"][0]
    along_x = (dominant == AXIS_COLOURS[0]).all(axis=-1)
    # The corner of a texture is its background.
    preserved = np.where(along_x[..., None], dominant, dominant[0, 0])
    tiles = [
        Tile(enlarged(image, 260), name, note)
        for image, name, note in (
            (images["x_depth"][0], "(a) depth", "bright is near"),
            (images["x_normal"][0], "(b) normal n", "(n + 1) / 2 as red, green, blue"),
            (dominant, "(c) largest |n|", "red x, green y, blue z"),
            (preserved, "(d) preserved", "along x"),
        )
    ]
    colours = [(int(r), int(g), int(b)) for r, g, b in AXIS_COLOURS[:3]]
    legend = Legend(
        tuple(zip("xyz", colours, strict=True)),
        "axis with the largest component of the normal",
    )
    title = "First texture of a sphere along x"
    stored = _storage(grid)
    return Finding(
        _storage_verdict(stored),
        {**stored, "exact_stored_over_peeled": _stored_of_a_sphere()},
        {"figure-4.5": sheet(tiles, legend, title, columns=4)},
    )


def _stored_of_a_sphere() -> float:
    """Mean of max |n| over that of |n_x| + |n_y| + |n_z|, over all directions."""
    count = 400
    z = (np.arange(count) + 0.5) / count
    angle = (np.arange(count) + 0.5) / count * np.pi / 2
    across = np.sqrt(1 - z**2)[:, None]
    x = across * np.cos(angle)
    y = across * np.sin(angle)
    largest = np.maximum(np.maximum(x, y), z[:, None])
    return float(largest.mean() / (x + y + z[:, None]).mean())


@exhibit("figure-4.6", "4.2, figure 4.6")
def _packed_textures(_: bool) -> Finding:
    """Pack the textures of the Happy Buddha."""
    statue = buddha()
    grid = statue.grid(_HEIGHT, "dominant_axis")
    peeled, packed = _layer_counts(grid)
    stored = _storage(grid)
    ratio = sum(packed) / sum(peeled)
    is_half = abs(ratio - 0.5) <= 0.1
    is_reproduced = is_half and packed == _PACKED
    return Finding(
        judged(is_reproduced, different=True),
        {
            "mesh": statue.name,
            **_layer_numbers(peeled, packed),
            "with_a_texel": _layers_with_a_texel(grid),
            "ratio": ratio,
            "ratio_thesis": sum(_PACKED) / sum(_PEELED),
            **stored,
        },
        {"figure-4.6": _packing_steps(grid)},
        {
            "C09": _storage_verdict(stored),
            "C10": judged(is_half),
        },
    )


def _layers_with_a_texel(grid: jt.VoxelGrid) -> list[int]:
    """Layers with any texel left along the thesis' x, y, z, before packing."""
    _, dominant = face_axes(grid.mesh)
    counts = []
    for axis in AXES.values():
        layers = peel_axes(grid.mesh, grid.lattice)[axis]
        is_stored = dominant[layers.triangle] == axis
        counts.append(len(np.unique(layers.layer[is_stored])))
    return counts


def _packing_steps(grid: jt.VoxelGrid) -> Image.Image:
    """Textures along the thesis' z as peeled, stored and packed, a row each."""
    axis = AXES["z"]
    name = "xyz"[axis]
    images = layer_images(grid)
    original: list[UInt8[np.ndarray, "h w 3"]] = images[f"{name}_normal"]
    packed = list(images[f"{name}_packed"])
    stored = [
        np.where(
            (dominant == AXIS_COLOURS[axis]).all(axis=-1)[..., None],
            pixels,
            original[0][0, 0],
        )
        for dominant, pixels in zip(images[f"{name}_dominant"], original, strict=True)
    ]
    empty = np.full_like(original[0], 64)
    packed += [empty] * (len(original) - len(packed))
    tiles = [
        Tile(pixels, f"({letter}) {k + 1}" if pixels is not empty else "removed")
        for letter, textures in (("a", original), ("b", stored), ("c", packed))
        for k, pixels in enumerate(textures)
    ]
    legend = normal_legend("direction of the outward normal; dark: no surface", WAYS)
    title = "Textures along z: (a) original, (b) stored, (c) packed"
    return sheet(tiles, legend, title, columns=len(original))


def _storage(grid: jt.VoxelGrid) -> dict[str, float]:
    """Texels for each voxel of the surface before and after duplicates are removed.

    Args:
        grid: voxelized with `surface_cells="dominant_axis"`.
    """
    views = peel_axes(grid.mesh, grid.lattice)
    peeled = np.concatenate([_cells(views[axis], axis) for axis in range(3)])
    position = grid.lattice.to_cells(grid.fragment_position)
    texels = np.floor(position).astype(np.int64)
    shell = {tuple(voxel) for voxel in surface_voxels(grid.solid).tolist()}
    with_texel = {tuple(voxel) for voxel in grid.fragment_voxel.tolist()}
    voxels_peeled = len(np.unique(peeled, axis=0))
    voxels_stored = len(np.unique(texels, axis=0))
    square_texels = len(texels) * grid.pitch**2 / grid.mesh.area
    return {
        "texels_peeled": len(peeled),
        "voxels_peeled": voxels_peeled,
        "texels_for_a_voxel_peeled": len(peeled) / voxels_peeled,
        "texels_stored": len(texels),
        "voxels_stored": voxels_stored,
        "texels_for_a_voxel_stored": len(texels) / voxels_stored,
        "stored_twice": len(texels) / voxels_stored - 1,
        "stored_over_peeled": len(texels) / len(peeled),
        "shell_voxels": len(shell),
        "shell_voxels_with_a_texel": len(shell & with_texel) / len(shell),
        "shell_voxels_without_a_texel": 1 - len(shell & with_texel) / len(shell),
        "texels_outside_the_shell": len(with_texel - shell) / len(with_texel),
        "area_over_the_mesh": 1 / grid.area_ratio,
        "area_of_square_texels_over_the_mesh": square_texels,
    }


def _storage_verdict(stored: Mapping[str, float]) -> Verdict:
    """Verdict on "each piece of surface once" for a body."""
    twice = stored["stored_twice"]
    area_error = abs(stored["area_over_the_mesh"] - 1)
    is_near = area_error <= _MAX_AREA_ERROR and twice < _MAX_STORED_TWICE
    is_exact = twice < 1e-3 and stored["shell_voxels_without_a_texel"] < 1e-3
    return judged(is_near and is_exact, different=is_near)


@exhibit("section-6.3-layers", "6.3")
def _layers_of_two_bodies(quick: bool) -> Finding:
    """Compare the layers of Happy Buddha and Max Planck with those of 6.3."""
    head = planck()
    statue = buddha()
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    table = [*_layers_by_height(head, heights), *_layers_by_height(statue, heights)]
    head_peeled, head_packed = _layer_counts(head.grid(_HEIGHT, "dominant_axis"))
    peeled, packed = _layer_counts(statue.grid(_HEIGHT, "dominant_axis"))
    has_fewer = all(a <= b for a, b in zip(head_packed, packed, strict=True))
    return Finding(
        Verdict.DIFFERENT,
        {
            "mesh": statue.name,
            "planck": {
                **_layer_numbers(head_peeled, head_packed),
                "is_closed": head.mesh.is_watertight,
            },
            "buddha": _layer_numbers(peeled, packed),
            "thesis": {"planck": _PLANCK_6_3, "buddha": _BUDDHA_6_3},
            "by_height": table,
            "some_height_has_it": any(
                list(_BUDDHA_6_3) in (row["peeled"], row["packed"]) for row in table
            ),
        },
        claims={"C26": judged(has_fewer)},
    )

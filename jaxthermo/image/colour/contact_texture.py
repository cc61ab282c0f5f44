"""Contact textures (thesis 5.3, figures 5.4 and 5.5): layers in false colours.

They show one value per fragment, such as the fraction in contact or the heat flux
through it; fragments without a value are grey.
"""

import numpy as np
from jaxtyping import Float, UInt8

from ...arrays import Scalar
from ...voxels.grid import VoxelGrid
from ...voxels.textures import packed_images
from .palette import apply_palette


# sRGB of fragments without a value: dark, and in no palette.
_UNTOUCHED = (52, 55, 62)


def contact_images(
    grid: VoxelGrid,
    values: Float[np.ndarray, " s"],
    low: Scalar = 0.0,
    high: Scalar = 1.0,
    palette: str = "iron",
    quantity: str = "contact",
) -> dict[str, list[UInt8[np.ndarray, "h w 3"]]]:
    """Draw the packed layers along x, y and z, front layer first.

    The keys are "x_contact" and so on, for axes and layers with any value.

    Args:
        grid: of the body.
        values: of every fragment; NaN where it is not in contact.
        low: value of the first colour.
        high: value of the last colour.
        palette: name of the palette.
        quantity: second half of the keys.

    Raises:
        InputError: for an unknown palette, or limits that are not finite and in order.
    """
    column = apply_palette(
        values[:, None], low=low, high=high, name=palette, invalid=_UNTOUCHED
    )
    images = {}
    for axis in range(3):
        with_value = grid.is_packed(axis) & ~np.isnan(values)
        if with_value.any():
            last = int(grid.fragment_layer[with_value, 1].max())
            layers = packed_images(grid, axis, column[:, 0])[: last + 1]
            images[f"{'xyz'[axis]}_{quantity}"] = layers
    return images

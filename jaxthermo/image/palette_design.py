"""Builds the palettes; the only file that imports colour-science.

The library reads the baked `palettes.json` instead (`import colour` takes seconds).
After a change here, bake again: `python -m jaxthermo.image.palette_design`.
"""

import json
import sys
import warnings
from math import comb
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8


# colour warns about a plotting library that we do not have, and leaves stand-ins for it
# in sys.modules, after which importing that library "succeeds" anywhere.
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import colour
for _name in [key for key in sys.modules if key.startswith("matplotlib")]:
    del sys.modules[_name]

ENTRIES = 256
BAKED = Path(__file__).with_name("palettes.json")

# (position, r, g, b) anchors, sRGB 0-255. The order of colours is that of thermal
# cameras; the values are ours.
_IRON = (
    (0.00, 4, 2, 12),
    (0.10, 30, 4, 78),
    (0.22, 88, 6, 132),
    (0.36, 156, 18, 140),
    (0.50, 212, 48, 92),
    (0.62, 238, 94, 32),
    (0.75, 251, 152, 10),
    (0.87, 255, 212, 58),
    (0.95, 255, 243, 160),
    (1.00, 255, 255, 244),
)
_RAINBOW = (
    (0.00, 42, 10, 92),
    (0.12, 36, 44, 190),
    (0.27, 20, 130, 235),
    (0.40, 24, 200, 196),
    (0.52, 70, 205, 70),
    (0.64, 200, 222, 40),
    (0.76, 252, 190, 24),
    (0.88, 240, 80, 20),
    (1.00, 170, 10, 30),
)
# Bezier control points (J', a', b') in CAM16-UCS: blue-black, violet, red, orange, pale
# yellow. One polynomial bends gently everywhere, so no band of colour stands out.
_EMBER = (
    (5.0, 1.5, -9.6),
    (14.0, 5.0, -33.9),
    (34.0, 44.8, -24.9),
    (50.0, 59.1, 21.2),
    (66.0, 23.6, 40.0),
    (84.0, -8.3, 33.7),
    (97.0, -4.6, 6.1),
)


def _through_anchors(anchors) -> Float[np.ndarray, "256 3"]:
    """Straight between the anchors in sRGB, then smoothed so that no kink shows."""
    table = np.asarray(anchors, np.float64)
    reach = 40
    offsets = np.arange(-reach, reach + 1)
    weight = np.exp(-0.5 * (offsets / 8.0) ** 2)
    weight /= weight.sum()
    x = np.linspace(0.0, 1.0, ENTRIES)
    columns = []
    for channel in table[:, 1:].T:
        line = np.interp(x, table[:, 0], channel / 255.0)
        # Odd reflection keeps both end colours exactly.
        wide = np.pad(line, reach, mode="reflect", reflect_type="odd")
        columns.append(np.convolve(wide, weight, mode="valid"))
    return np.clip(np.stack(columns, axis=-1), 0.0, 1.0)


def ember_ucs() -> Float[np.ndarray, "256 3"]:
    """The ember palette in CAM16-UCS (J', a', b'), in steps of equal length.

    A Bezier curve B(s) = sum_i C(n,i) s^i (1-s)^(n-i) P_i, resampled by arc length, so
    that equal temperature steps look equally large; J' rises throughout.

    Source: CAM16-UCS, Li et al., Color Res. Appl. 42 (2017) 703.
    """
    points = np.asarray(_EMBER)
    order = len(points) - 1
    s = np.linspace(0.0, 1.0, 8 * ENTRIES)[:, None]
    i = np.arange(order + 1)[None, :]
    choose = np.asarray([comb(order, k) for k in range(order + 1)], np.float64)
    curve = (choose[None, :] * s**i * (1.0 - s) ** (order - i)) @ points
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    along = np.concatenate([np.zeros(1), np.cumsum(length)])
    even = np.linspace(0.0, along[-1], ENTRIES)
    return np.stack([np.interp(even, along, c) for c in curve.T], axis=-1)


def rgb_to_ucs(rgb: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """CAM16-UCS (J', a', b') of sRGB in 0-1, J' in 0-100."""
    return np.asarray(colour.XYZ_to_CAM16UCS(colour.sRGB_to_XYZ(rgb)))


def ucs_to_rgb(ucs: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Gives sRGB of CAM16-UCS, not clipped: outside 0-1 it cannot be shown."""
    return np.asarray(colour.XYZ_to_sRGB(colour.CAM16UCS_to_XYZ(ucs)))


def build_palettes() -> dict[str, UInt8[np.ndarray, "256 3"]]:
    """All palettes, from cold to hot, by name."""
    grey = np.repeat(np.linspace(0.0, 1.0, ENTRIES)[:, None], 3, axis=1)
    tables = {
        "iron": _through_anchors(_IRON),
        "ember": np.clip(ucs_to_rgb(ember_ucs()), 0.0, 1.0),
        "white-hot": grey,
        "black-hot": grey[::-1],
        "rainbow": _through_anchors(_RAINBOW),
    }
    return {k: np.rint(255.0 * v).astype(np.uint8) for k, v in tables.items()}


def bake(path: Path = BAKED) -> None:
    """Writes the palettes as rows of 16 hexadecimal colours."""
    rows = {
        name: [table[k : k + 16].tobytes().hex() for k in range(0, ENTRIES, 16)]
        for name, table in build_palettes().items()
    }
    path.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    bake()

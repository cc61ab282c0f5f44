"""Design of the palettes, and a report of how uniform and distinguishable they are.

The only module that imports colour-science, which takes seconds: import it lazily. All
others read `palettes.json`; after a change here write it again by
`python -m jaxthermo.image.colour.palette_design`.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from scipy.special import comb

from .palette import ENTRIES, palette_names, palette_table


# colour warns about a plotting library that is not installed, and leaves stand-ins for
# it in sys.modules, after which importing that library "succeeds" anywhere.
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import colour

    # Linear RGB as seen without one kind of cone; for tritanopia only approximate, of
    # which colour warns.
    _VISION = {
        "normal": np.eye(3),
        "protanopia": colour.matrix_cvd_Machado2009("Protanomaly", 1.0),
        "deuteranopia": colour.matrix_cvd_Machado2009("Deuteranomaly", 1.0),
        "tritanopia": colour.matrix_cvd_Machado2009("Tritanomaly", 1.0),
    }
for _name in [key for key in sys.modules if key.startswith("matplotlib")]:
    del sys.modules[_name]

_BAKED = Path(__file__).with_name("palettes.json")

_DESIGN = json.loads(Path(__file__).with_suffix(".json").read_text())
# (position, r, g, b) of each palette, sRGB 0-255. The order of colours is that of
# thermal cameras; the values are not.
_ANCHORS = _DESIGN["anchors"]
# Bezier control points (J', a', b') in CAM16-UCS. One polynomial is smooth everywhere,
# so that no band of colour stands out. Ember: blue-black, violet, red, orange, pale
# yellow. Arctic: night blue, blue, grey, gold, cream, which most of the colour-blind
# tell apart. Lava: black, dark red, red, orange, pale yellow, as of a body that begins
# to glow.
_CONTROLS = _DESIGN["controls"]


def _through_anchors(anchors) -> Float[np.ndarray, "256 3"]:
    # Smoothed, or the eye would see a band at every kink between two anchors.
    table = np.asarray(anchors, np.float64)
    width = 40
    offsets = np.arange(-width, width + 1)
    weight = np.exp(-0.5 * (offsets / 8.0) ** 2)
    weight /= weight.sum()
    x = np.linspace(0.0, 1.0, ENTRIES)
    columns = []
    for channel in table[:, 1:].T:
        line = np.interp(x, table[:, 0], channel / 255.0)
        # Odd reflection preserves both end colours exactly.
        wide = np.pad(line, width, mode="reflect", reflect_type="odd")
        columns.append(np.convolve(wide, weight, mode="valid"))
    return np.clip(np.stack(columns, axis=-1), 0.0, 1.0)


def _even_ucs(controls) -> Float[np.ndarray, "256 3"]:
    # A Bezier curve B(s) = sum_i C(n,i) s^i (1-s)^(n-i) P_i, resampled by arc length:
    # equal temperature steps look equally large; the lightness J' rises throughout.
    # Source: CAM16-UCS (J', a', b'), Li et al., Color Res. Appl. 42 (2017) 703.
    points = np.asarray(controls)
    order = len(points) - 1
    s = np.linspace(0.0, 1.0, 8 * ENTRIES)[:, None]
    i = np.arange(order + 1)[None, :]
    choose = np.asarray(comb(order, np.arange(order + 1)))
    curve = (choose[None, :] * s**i * (1.0 - s) ** (order - i)) @ points
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    along = np.insert(np.cumsum(length), 0, 0.0)
    even = np.linspace(0.0, along[-1], ENTRIES)
    return np.stack([np.interp(even, along, c) for c in curve.T], axis=-1)


def _rgb_to_ucs(rgb: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return np.asarray(colour.XYZ_to_CAM16UCS(colour.sRGB_to_XYZ(rgb)))


def _ucs_to_rgb(ucs: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    # Not clipped: a test finds colours outside 0-1, which cannot be displayed.
    return np.asarray(colour.XYZ_to_sRGB(colour.CAM16UCS_to_XYZ(ucs)))


def _displayed(ucs: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return np.clip(_ucs_to_rgb(ucs), 0.0, 1.0)


def _build_palettes() -> dict[str, UInt8[np.ndarray, "256 3"]]:
    grey = np.repeat(np.linspace(0.0, 1.0, ENTRIES)[:, None], 3, axis=1)
    tables = {
        "iron": _through_anchors(_ANCHORS["iron"]),
        "ember": _displayed(_even_ucs(_CONTROLS["ember"])),
        "white-hot": grey,
        "black-hot": grey[::-1],
        "rainbow": _through_anchors(_ANCHORS["rainbow"]),
        "arctic": _displayed(_even_ucs(_CONTROLS["arctic"])),
        "lava": _displayed(_even_ucs(_CONTROLS["lava"])),
    }
    return {k: np.rint(255.0 * v).astype(np.uint8) for k, v in tables.items()}


def _bake(path: Path = _BAKED) -> None:
    rows = {
        name: [table[k : k + 16].tobytes().hex() for k in range(0, ENTRIES, 16)]
        for name, table in _build_palettes().items()
    }
    path.write_text(json.dumps(rows, indent=1) + "\n")


def _colour_difference(
    first: UInt8[np.ndarray, "*n 3"], second: UInt8[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n"]:
    # About 1 is just noticeable side by side. Source: CIE 142 (2001).
    a, b = (_lab(colours / 255.0) for colours in (first, second))
    return np.asarray(colour.delta_E(a, b, method="CIE 2000"))


def palette_report() -> dict[str, dict[str, float]]:
    """Uniformity and distinguishability of each palette, as CIEDE2000 differences [-].

    Per palette `step_min`, `step_mean` and `step_max` of neighbouring colours, and the
    smallest difference of two colours at least 1/8 of the scale apart in normal vision
    (`apart_normal`) and as simulated for a complete lack of one kind of cone
    (`apart_protanopia`, `apart_deuteranopia`, `apart_tritanopia`): close to 0, two
    temperatures look the same.

    Source: Machado, Oliveira and Fernandes, IEEE TVCG 15 (2009) 1291.
    """
    report = {}
    for name in palette_names():
        table = palette_table(name)
        steps = _colour_difference(table[:-1], table[1:])
        facts = {
            "step_min": float(steps.min()),
            "step_mean": float(steps.mean()),
            "step_max": float(steps.max()),
        }
        for vision, matrix in _VISION.items():
            # The model acts on linear RGB; its colours may leave the gamut slightly.
            linear = colour.cctf_decoding(table / 255.0, function="sRGB") @ matrix.T
            seen = colour.cctf_encoding(np.clip(linear, 0.0, 1.0), function="sRGB")
            facts[f"apart_{vision}"] = _smallest_difference(_lab(np.asarray(seen)))
        report[name] = facts
    return report


def _lab(rgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return np.asarray(colour.XYZ_to_Lab(colour.sRGB_to_XYZ(rgb)))


def _smallest_difference(lab: Float[np.ndarray, "n 3"]) -> float:
    first, second = np.triu_indices(len(lab), len(lab) // 8)
    return float(np.min(colour.delta_E(lab[first], lab[second], method="CIE 2000")))


if __name__ == "__main__":
    _bake()

"""Sections 1.3, 5.1 and 7: a thermal image of stored heat and reflected radiation."""

import jaxthermo as jt
from jaxthermo.image.radiance.band import LONG_WAVE

from ..bodies import buddha
from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..image_parts import (
    AT_ONE,
    AT_PAINT,
    CHOSEN,
    ITSELF,
    LONG,
    MID,
    MID_WAVE,
    OF_AROUND,
    OF_SUN,
    PAINT,
    SHINY,
    STORED,
    WHOLE,
    band_rows,
    band_table,
    radiance_sheet,
    reading_sheet,
    readings,
    separate,
    statue_scene,
)


_HEIGHT, _QUICK_HEIGHT = 160, 60
# Relative difference up to which a sum is exact: a few roundings of float64, and in a
# band the radiance of a surface without heat, whose temperature stands at 50 K.
_ROUNDING = 1e-7
# Black radiance by independent quadratures of Planck's law [K], [W/(m^2 sr)].
_KELVIN = (250.0, 300.0, 350.0, 400.0)
_LONG_RADIANCE = (23.5608, 59.3117, 117.075, 197.667)
_MID_RADIANCE = (0.217035, 1.86596, 8.97435, 29.8473)
# Temperature that is shown of 310 K before 293.15 K, by emissivity.
_SHOWN = {0.95: 309.217275, 0.8: 306.835584, 0.5: 301.910518, 0.1: 294.963569}


def _known_rows() -> tuple[tuple[Row, ...], float]:
    """Numbers of a camera's model measured again, and their largest difference."""
    bands = (LONG, LONG_WAVE, _LONG_RADIANCE), (MID, MID_WAVE, _MID_RADIANCE)
    found = [
        (f"black, {at:g} K, {name} [W/(m² sr)]", known, band.radiance(at))
        for name, band, values in bands
        for at, known in zip(_KELVIN, values, strict=True)
    ]
    through_air = jt.measured_radiance(350.0, 0.9, 293.15, 0.95, 290.0)
    found += [
        (f"dL/dT, 300 K, {LONG} [W/(m² sr K)]", 0.928314, LONG_WAVE.slope(300.0)),
        (f"share of σ T⁴, 300 K, {LONG}", 0.405689, LONG_WAVE.share(300.0)),
        (f"60 W/(m² sr), {LONG} [K]", 300.738830, LONG_WAVE.temperature(60.0)),
        (f"2 W/(m² sr), {MID} [K]", 301.923589, MID_WAVE.temperature(2.0)),
        (
            "350 K of emissivity 0.9 before 293.15 K, through air [W/(m² sr)]",
            *(107.672617, through_air),
        ),
    ]
    for emissivity, known in _SHOWN.items():
        radiance = jt.measured_radiance(310.0, emissivity, 293.15)
        name = f"310 K of emissivity {emissivity:g} before 293.15 K, shown [K]"
        found.append((name, known, LONG_WAVE.temperature(radiance)))
    rows = tuple(
        Row(name, None, f"{float(ours):.9g}", f"by quadrature {known:.9g}")
        for name, known, ours in found
    )
    return rows, max(abs(float(ours) / known - 1) for _, known, ours in found)


def _measure(quick: bool) -> Finding:
    height = _QUICK_HEIGHT if quick else _HEIGHT
    frame = separate(*statue_scene(height))
    read, bands = readings(frame), band_rows(frame)
    known, off = _known_rows()
    sums = {band: parts.sum_error for band, parts in frame.parts.items()}
    paint, patch = (row for row in bands if row["band"] == LONG)
    stored = {row["surface"]: row[STORED] / row[WHOLE] for row in (paint, patch)}
    of_source = {
        row["band"]: row[OF_SUN] / (row[OF_SUN] + row[OF_AROUND])
        for row in bands
        if row["surface"] == "patch"
    }
    bright = next(row for row in bands if row["band"] not in (LONG, MID))
    shown = {name: float(k[frame.shiny].mean()) for name, k in read.frames.items()}
    exact = max(sums.values()) <= _ROUNDING
    reason = (
        f"Stored heat alone and reflections alone {'' if exact else 'do not '}add up "
        "to the image of both: the largest difference of a pixel is "
        f"{max(sums.values()):.0e} of it. From {LONG} the radiance of paint is "
        f"{stored['paint']:.0%} stored heat, that of a shiny patch "
        f"{stored['patch']:.0%}. Of what the patch reflects there the heat source, "
        f"whose reflection the thesis draws, is {of_source[LONG]:.1%}; the rest is of "
        f"sky and ground. From {MID} it is {of_source[MID]:.0%}. Over all wavelengths "
        "the sun that paint reflects is "
        f"{bright[OF_SUN] / bright[STORED]:.0%} of its stored heat. A camera shows the "
        f"patch of {shown[ITSELF]:.1f} K as {shown[AT_ONE]:.1f} K, "
        f"and at its own emissivity is wrong by {abs(read.spot_per_kelvin):.0f} K for "
        "each kelvin that the reflected temperature is."
    )
    if not exact:
        verdict = Verdict.CONTRADICTED
    else:
        verdict = Verdict.DIFFERENT if of_source[LONG] < 0.5 else Verdict.REPRODUCED
    foil = f"{read.reflected:.1f} K reflected, as foil before it shows"
    rows = (
        *(
            Row(f"sum of the parts less the whole, {band}", "blended", error)
            for band, error in sums.items()
        ),
        Row("stored heat in the radiance of paint", None, stored["paint"]),
        Row("stored heat in that of the patch", None, stored["patch"]),
        *(
            Row(f"the source in what the patch reflects, {band}", "alone drawn", share)
            for band, share in of_source.items()
        ),
        Row("patch, surface itself [K]", None, f"{shown[ITSELF]:.1f}"),
        Row("patch, camera at emissivity 1 [K]", None, f"{shown[AT_ONE]:.1f}"),
        Row(f"patch, camera at {PAINT:g} [K]", None, f"{shown[AT_PAINT]:.1f}", foil),
        Row(
            f"patch, its mean radiance at its own {SHINY:g} [K]",
            *(None, f"{read.spot:.1f}"),
            f"{read.spot_per_kelvin:+.1f} K for 1 K more reflected",
        ),
        *known,
    )
    chosen = (*buddha().stands_in, *CHOSEN, ("voxels", f"{height} high"))
    parts = (
        Picture(
            "image-parts",
            radiance_sheet(frame),
            "One view on one scale: the first three add up to the last. Of these the "
            "thesis draws the first and the second.",
        ),
        Picture(
            "image-readings",
            reading_sheet(frame, read),
            "The camera set to the paint is right but on the patch, which mirrors the "
            "sky above its folds and the ground below them.",
        ),
        band_table(bands),
        "“If we replace reflection coefficients by thermal reflection coefficients in "
        "traditional graphics rendering, we can get same result of thermal image” "
        "(1.2): in the long wave a surface reflects sky, ground and its neighbours, as "
        "bright as it is itself, and hardly the sun. A renderer of one distant source "
        "has none of them.",
        f"{len(known)} numbers of the camera's model, measured again, are within "
        f"{off:.0e} of those by quadrature.",
    )
    numbers = {"sum_error": sums, "radiances": bands, "shown_K": shown, "off": off}
    return Finding(verdict, reason, rows, {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="section-1.3-image",
    title="a thermal image of stored heat and reflected radiation",
    place="1.3; 5.1; 7",
    claims=("C25",),
    measure=_measure,
)

"""1.3, 5.1 and 7: thermal images of stored heat and reflected radiation."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.image.radiance.band import LONG_WAVE, Band
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.radiance.response import BANDS
from jaxthermo.image.surface.camera import Camera, frame_all
from jaxthermo.image.surface.view import kept_view
from jaxthermo.physics.radiation.irradiation import Irradiance

from ...harness.present import Shot, thermal_sheet
from ..bodies import buddha
from ..exhibit import Finding, Numbers, exhibit, judged


PAINT = 0.9
"""Emissivity of the statue [-]."""
SHINY = 0.1
"""Emissivity of a patch of bare metal on it [-]."""
LONG = "7.5 to 14 µm"
_MID = "3 to 5 µm"
_ALL = "all wavelengths"
_MID_WAVE = Band(BANDS["mid-wave"])
_BANDS = {LONG: LONG_WAVE, _MID: _MID_WAVE, _ALL: None}
# Radiances of a frame by what they come from.
_STORED = "stored heat"
OF_SUN = "sun reflected"
OF_AROUND = "sky and ground reflected"
_TOTAL = "all together"
# Temperatures of a frame by how they are read.
ITSELF = "surface itself"
AT_ONE = "camera at emissivity 1"
_AT_PAINT = f"camera at {PAINT:g}"

# Warm at the start, in a cooler afternoon: air, sky and ground [K].
_WARM = 330.0
_AIR = 298.15
_SKY = 268.15
_GROUND = 303.15
_SUN = jt.Sun((-0.6, 1.0, -0.9), 800.0)
_TIME = 1800.0
# Corners of the patch over width, depth and height of the body.
_PATCH = ((0.3, -0.1, 0.42), (0.75, 0.5, 0.6))
# Relative difference up to which a sum is exact: a few roundings of float64, and in a
# band the radiance of a surface without heat, whose temperature stands at 50 K.
_ROUNDING = 1e-7
# Black radiance by independent quadratures of Planck's law [K], [W/(m^2 sr)].
_KELVIN = (250.0, 300.0, 350.0, 400.0)
_LONG_RADIANCE = (23.5608, 59.3117, 117.075, 197.667)
_MID_RADIANCE = (0.217035, 1.86596, 8.97435, 29.8473)
# Temperature that is shown of 310 K in front of 293.15 K, by emissivity.
_SHOWN = {0.95: 309.217275, 0.8: 306.835584, 0.5: 301.910518, 0.1: 294.963569}

Pixels = Float[np.ndarray, "h w"]
Flags = Bool[np.ndarray, "h w"]


class _Radiances(NamedTuple):
    """Radiances of every pixel in one band."""

    by_origin: dict[str, Pixels]
    """Radiance by what it comes from [W/(m^2 sr)]."""
    sum_error: float
    """Largest difference of the parts' sum from the total on the body, relative."""


class _Frame(NamedTuple):
    """A frame in parts, and where it shows what."""

    bands: dict[str, _Radiances]
    """Radiances by the name of the band."""
    temperature: Pixels
    """True temperature of the surface [K]."""
    body: Flags
    shiny: Flags
    paint: Flags


class _Readings(NamedTuple):
    """Temperatures that a camera shows, by its settings [K]."""

    frames: dict[str, Pixels]
    reflected: float
    """Temperature that the patch reflects, as foil in front of it shows."""
    spot: float
    """Mean radiance of the patch, read at its own emissivity."""
    spot_per_kelvin: float
    """Change of that reading if the reflected temperature is a kelvin higher [K]."""


@exhibit("section-1.3-image", "1.3; 5.1; 7")
def _image_of_heat_and_reflections(quick: bool) -> Finding:
    """Draw the statue in the sun in parts, and read it as a camera does."""
    height = 60 if quick else 160
    frame = separate(*_statue_scene(height))
    read = readings(frame)
    means = mean_radiances(frame)
    sum_error = {band: radiances.sum_error for band, radiances in frame.bands.items()}
    long_wave = {row["surface"]: row for row in means if row["band"] == LONG}
    of_source = {
        row["band"]: row[OF_SUN] / (row[OF_SUN] + row[OF_AROUND])
        for row in means
        if row["surface"] == "patch"
    }
    paint = next(row for row in means if row["band"] == _ALL)
    camera_numbers = _known_numbers()
    is_exact = max(sum_error.values()) <= _ROUNDING
    is_source = is_exact and of_source[LONG] >= 0.5
    return Finding(
        judged(is_source, different=is_exact),
        {
            "mesh": buddha().name,
            "height_voxels": height,
            "is_exact": is_exact,
            "sum_error": sum_error,
            "largest_sum_error": max(sum_error.values()),
            "stored": {
                name: row[_STORED] / row[_TOTAL] for name, row in long_wave.items()
            },
            "of_source": of_source,
            "sun_over_stored": paint[OF_SUN] / paint[_STORED],
            "radiances": means,
            "shown_K": {
                name: float(kelvin[frame.shiny].mean())
                for name, kelvin in read.frames.items()
            },
            "reflected_K": read.reflected,
            "spot_K": read.spot,
            "spot_per_kelvin": read.spot_per_kelvin,
            "known": {
                name: {source: f"{value:.9g}" for source, value in row.items()}
                for name, row in camera_numbers.items()
            },
            "off": max(
                abs(row["here"] / row["by quadrature"] - 1)
                for row in camera_numbers.values()
            ),
        },
        {
            "image-parts": _radiance_sheet(frame),
            "image-readings": _reading_sheet(frame, read),
        },
    )


def _statue_scene(height: int) -> tuple[jt.Solution, Camera]:
    """The statue, `height` voxels high, after its time in the sun, and a camera."""
    grid = buddha().grid(height)
    low, high = grid.mesh.bounds
    size = high - low
    lower, upper = (
        tuple((low + np.asarray(corner) * size).tolist()) for corner in _PATCH
    )
    painted = jt.Material(
        16.0, density=8000.0, specific_heat=500.0, emissivity=PAINT, absorptivity=0.6
    )
    bare = jt.Coating(SHINY, on=jt.Region(lower, upper))
    body = jt.Body(jt.FullVolume(grid), painted, temperature=_WARM, coatings=(bare,))
    terms = (_SUN, jt.Surroundings(_SKY, ground=_GROUND), jt.Convection(8.0, _AIR))
    scene = jt.Scene((body,), terms, dtype="float64")
    return jt.simulate(scene, _TIME), frame_all(grid.mesh.triangles, 250, 420)


def separate(solution: jt.Solution, camera: Camera) -> _Frame:
    """Frame of a camera, drawn as a whole and in parts in every band."""
    with precision(solution.receipt.dtype):
        bands = {
            name: _radiances(solution, camera, band) for name, band in _BANDS.items()
        }
        image = jt.render(solution, camera)
    emissivity = np.asarray(image.emissivity)
    body = np.asarray(image.object_id) >= 0
    return _Frame(
        bands=bands,
        temperature=np.asarray(image.temperature),
        body=body,
        shiny=body & (np.abs(emissivity - SHINY) < 1e-6),
        paint=body & (np.abs(emissivity - PAINT) < 1e-6),
    )


def _radiances(solution: jt.Solution, camera: Camera, band: Band | None) -> _Radiances:
    """Draw a view with all that reaches the camera, and with each origin alone."""
    view = kept_view(solution.surfaces, solution.terms, camera)
    kelvin = np.asarray(solution.surface_temperature[-1])
    received = Irradiance(*(np.asarray(values) for values in solution.irradiance(-1)))
    no_thermal = np.zeros_like(received.thermal)
    no_sources = np.zeros_like(received.sources)
    cold = np.zeros_like(kelvin)
    states: dict[str, tuple[np.ndarray, Irradiance | None]] = {
        _STORED: (kelvin, None),
        OF_SUN: (cold, received._replace(thermal=no_thermal)),
        OF_AROUND: (cold, received._replace(sources=no_sources)),
        _TOTAL: (kelvin, received),
    }
    by_origin = {}
    for name, (temperature, irradiance) in states.items():
        moment = Moment(
            surfaces=solution.surfaces,
            terms=solution.terms,
            temperature=temperature,
            received=irradiance,
            time=solution.times[-1],
            load_time=solution.load_time(-1),
        )
        frame = draw(view, moment, band)
        by_origin[name] = np.asarray(frame.radiance)
    body = np.asarray(frame.object_id) >= 0
    added = sum(by_origin[name][body] for name in states if name != _TOTAL)
    error = np.abs(added / by_origin[_TOTAL][body] - 1).max()
    return _Radiances(by_origin, float(error))


def _radiance_sheet(frame: _Frame) -> Image.Image:
    """The parts of a frame and the total on one scale."""
    radiances = frame.bands[LONG].by_origin
    high = float(np.percentile(radiances[_TOTAL][frame.body], 99.8))
    return thermal_sheet(
        _shots(frame, radiances, "paint {:.3g}, patch {:.3g}"),
        limits=(0.0, high),
        scale="radiance from 7.5 to 14 um [W/(m^2 sr)]",
        title="What a thermal image is made of",
    )


def _shots(frame: _Frame, pictures: Mapping[str, Pixels], note: str) -> list[Shot]:
    """Pictures of the frame, with their means on paint and patch in a note."""
    shots = []
    for name, values in pictures.items():
        paint = values[frame.paint].mean()
        patch = values[frame.shiny].mean()
        shots.append(Shot(values, frame.body, name, note.format(paint, patch)))
    return shots


def readings(frame: _Frame) -> _Readings:
    """Readings of a camera that knows what the patch reflects."""
    radiances = frame.bands[LONG].by_origin
    seen = radiances[_TOTAL]
    of_patch = float(seen[frame.shiny].mean())
    mirrored = (of_patch - radiances[_STORED][frame.shiny].mean()) / (1 - SHINY)
    around = float(LONG_WAVE.temperature(mirrored))
    spot = float(jt.object_temperature(of_patch, SHINY, around))
    spot_of_warmer = float(jt.object_temperature(of_patch, SHINY, around + 1.0))
    frames = {
        ITSELF: frame.temperature,
        AT_ONE: LONG_WAVE.temperature(seen),
        _AT_PAINT: jt.object_temperature(seen, PAINT, around),
    }
    return _Readings(frames, around, spot, spot_of_warmer - spot)


def _reading_sheet(frame: _Frame, read: _Readings) -> Image.Image:
    """The surface and readings of it on one scale."""
    on_patch = [values[frame.shiny].mean() for values in read.frames.values()]
    low = float(min(on_patch))
    high = float(np.percentile(read.frames[ITSELF][frame.body], 99.5))
    return thermal_sheet(
        _shots(frame, read.frames, "paint {:.1f} K, patch {:.1f} K"),
        limits=(low, high),
        scale="temperature [K]",
        title="What a camera reads of it, with a shiny patch",
    )


def mean_radiances(frame: _Frame) -> list[Numbers]:
    """Means of the radiances on paint and patch, a row for each band."""
    return [
        {
            "band": band,
            "surface": surface,
            **{
                name: float(values[pixels].mean())
                for name, values in radiances.by_origin.items()
            },
        }
        for band, radiances in frame.bands.items()
        for surface, pixels in (("paint", frame.paint), ("patch", frame.shiny))
    ]


def _known_numbers() -> Mapping[str, dict[str, float]]:
    """Numbers of a camera's model, measured again and by quadrature."""
    rows: list[tuple[str, float, Any]] = [
        (f"black, {kelvin:g} K, {name} [W/(m² sr)]", exact, band.radiance(kelvin))
        for name, band, values in (
            (LONG, LONG_WAVE, _LONG_RADIANCE),
            (_MID, _MID_WAVE, _MID_RADIANCE),
        )
        for kelvin, exact in zip(_KELVIN, values, strict=True)
    ]
    through_air = jt.measured_radiance(350.0, 0.9, 293.15, 0.95, 290.0)
    rows += [
        (f"dL/dT, 300 K, {LONG} [W/(m² sr K)]", 0.928314, LONG_WAVE.slope(300.0)),
        (f"share of σ T⁴, 300 K, {LONG}", 0.405689, LONG_WAVE.share(300.0)),
        (f"60 W/(m² sr), {LONG} [K]", 300.738830, LONG_WAVE.temperature(60.0)),
        (f"2 W/(m² sr), {_MID} [K]", 301.923589, _MID_WAVE.temperature(2.0)),
        (
            "350 K of emissivity 0.9 in front of 293.15 K, through air [W/(m² sr)]",
            107.672617,
            through_air,
        ),
    ]
    for emissivity, exact in _SHOWN.items():
        radiance = jt.measured_radiance(310.0, emissivity, 293.15)
        name = f"310 K of emissivity {emissivity:g} in front of 293.15 K, shown [K]"
        rows.append((name, exact, LONG_WAVE.temperature(radiance)))
    return {
        name: {"here": float(computed), "by quadrature": exact}
        for name, exact, computed in rows
    }

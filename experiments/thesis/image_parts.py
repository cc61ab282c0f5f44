"""Thermal images of stored heat and reflected radiation, and a camera's readings."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.image.radiance.band import LONG_WAVE, Band
from jaxthermo.image.radiance.draw import draw
from jaxthermo.image.radiance.response import BANDS
from jaxthermo.image.surface.camera import Camera, frame_all
from jaxthermo.image.surface.view import kept_view
from jaxthermo.physics.radiation.irradiation import Irradiance
from jaxthermo.report.sheet import sheet
from jaxthermo.report.table import Table

from ..harness.present import Rows, colour_bar, table_of, thermal_tile
from .bodies import buddha


PAINT, SHINY = 0.9, 0.1
"""Emissivity of the statue, and of a patch of bare metal on it [-]."""
MID_WAVE = Band(BANDS["mid-wave"])
LONG, MID = "7.5 to 14 µm", "3 to 5 µm"
STORED, OF_SUN, OF_AROUND = "stored heat", "sun reflected", "sky and ground reflected"
WHOLE = "all together"
"""Radiances of a frame by what they come from."""
ITSELF, AT_ONE = "surface itself", "camera at emissivity 1"
AT_PAINT = f"camera at {PAINT:g}"
"""Temperatures of a frame by how they are read."""

# Warm at the start, in a cooler afternoon: air, sky and ground [K].
_WARM, _AIR, _SKY, _GROUND = 330.0, 298.15, 268.15, 303.15
_SUN, _IRRADIANCE = (-0.6, 1.0, -0.9), 800.0
_TIME = 1800.0
# Corners of the patch over width, depth and height of the body.
_PATCH = (0.3, -0.1, 0.42), (0.75, 0.5, 0.6)
_SIZE = (250, 420)
_BANDS = {LONG: LONG_WAVE, MID: MID_WAVE, "all wavelengths": None}

CHOSEN = (
    (
        "scene",
        f"the statue, {_WARM:g} K at first, after {_TIME / 60:g} minutes in the sun of "
        f"{_IRRADIANCE:g} W/m², air of {_AIR:g} K, sky {_SKY:g} K, ground "
        f"{_GROUND:g} K; the thesis has no picture of a reflection",
    ),
    ("surface", f"paint of emissivity {PAINT:g}, with a patch of {SHINY:g}"),
    ("band", f"{LONG}; the thesis assumes a single wavelength, unnamed"),
)


class _Parts(NamedTuple):
    """Radiances of every pixel by what they come from, in one band."""

    radiance: dict[str, Float[np.ndarray, "h w"]]
    """By what they come from [W/(m^2 sr)]."""
    sum_error: float
    """Largest difference of the parts' sum from the whole on the body, relative."""


class Frame(NamedTuple):
    """A frame in parts, and where it shows what."""

    parts: dict[str, _Parts]
    """By band."""
    temperature: Float[np.ndarray, "h w"]
    """True temperature of the surface [K]."""
    body: Bool[np.ndarray, "h w"]
    shiny: Bool[np.ndarray, "h w"]
    paint: Bool[np.ndarray, "h w"]


def statue_scene(height: int) -> tuple[jt.Solution, Camera]:
    """The statue, so many voxels high, after its time in the sun, and a camera."""
    grid = buddha().grid(height)
    low, high = grid.mesh.bounds
    corners = (low + np.asarray(part) * (high - low) for part in _PATCH)
    lower, upper = (tuple(map(float, corner)) for corner in corners)
    bare = jt.Coating(SHINY, on=jt.Region(lower, upper))
    painted = jt.Material(
        16.0, density=8000.0, specific_heat=500.0, emissivity=PAINT, absorptivity=0.6
    )
    body = jt.Body(jt.FullVolume(grid), painted, temperature=_WARM, coatings=(bare,))
    terms = (
        jt.Sun(_SUN, _IRRADIANCE),
        jt.Surroundings(_SKY, ground=_GROUND),
        jt.Convection(8.0, _AIR),
    )
    scene = jt.Scene((body,), terms, dtype="float64")
    camera = frame_all(grid.mesh.triangles, *_SIZE)
    return jt.simulate(scene, _TIME), camera


def separate(solution: jt.Solution, camera: Camera) -> Frame:
    """Frame of a camera, drawn whole and in parts in every band."""
    with precision(solution.receipt.dtype):
        parts = {name: _parts(solution, camera, band) for name, band in _BANDS.items()}
        image = jt.render(solution, camera)
    emissivity = np.asarray(image.emissivity)
    body = np.asarray(image.object_id) >= 0
    return Frame(
        parts,
        np.asarray(image.temperature),
        body,
        body & (np.abs(emissivity - SHINY) < 1e-6),
        body & (np.abs(emissivity - PAINT) < 1e-6),
    )


def _parts(solution: jt.Solution, camera: Camera, band: Band | None) -> _Parts:
    """Draw the same view with all that reaches the camera, and with each part alone."""
    view = kept_view(solution.surfaces, solution.terms, camera)
    kelvin = np.asarray(solution.surface_temperature[-1])
    received = Irradiance(*(np.asarray(each) for each in solution.irradiance(-1)))
    dark, cold = np.zeros_like(received.thermal), np.zeros_like(kelvin)
    given: dict[str, tuple[np.ndarray, Irradiance | None]] = {
        STORED: (kelvin, None),
        OF_SUN: (cold, received._replace(thermal=dark)),
        OF_AROUND: (
            cold,
            received._replace(sources=np.zeros_like(received.sources)),
        ),
        WHOLE: (kelvin, received),
    }
    time = solution.times[-1]
    frames = {
        name: draw(
            *(view, solution.surfaces, solution.terms),
            *(*state, time, solution.load_time(-1), band),
        )
        for name, state in given.items()
    }
    found = {name: np.asarray(frame.radiance) for name, frame in frames.items()}
    body = np.asarray(frames[WHOLE].object_id) >= 0
    added = sum(found[name][body] for name in found if name != WHOLE)
    whole = found[WHOLE][body]
    return _Parts(found, float(np.abs(added / whole - 1).max()))


def radiance_sheet(frame: Frame) -> Image.Image:
    """The parts of a frame and the whole on one scale."""
    found = frame.parts[LONG].radiance
    high = float(np.percentile(found[WHOLE][frame.body], 99.8))
    tiles = [
        thermal_tile(
            *(values, frame.body, (0.0, high), name),
            f"paint {values[frame.paint].mean():.3g}, "
            f"patch {values[frame.shiny].mean():.3g}",
        )
        for name, values in found.items()
    ]
    bar = colour_bar(0.0, high, "radiance from 7.5 to 14 um [W/(m^2 sr)]")
    return sheet(tiles, bar, "What a thermal image is made of", columns=len(tiles))


class Readings(NamedTuple):
    """Temperatures that a camera shows, by its settings [K]."""

    frames: dict[str, Float[np.ndarray, "h w"]]
    reflected: float
    """Temperature that the patch reflects, as foil before it shows."""
    spot: float
    """Mean radiance of the patch, read at its own emissivity."""
    spot_per_kelvin: float
    """Difference that a kelvin more of the reflected makes to it [K]."""


def readings(frame: Frame) -> Readings:
    """Readings of a camera that knows what the patch reflects."""
    found = frame.parts[LONG].radiance
    seen, of_patch = found[WHOLE], float(found[WHOLE][frame.shiny].mean())
    mirrored = (of_patch - found[STORED][frame.shiny].mean()) / (1 - SHINY)
    around = float(LONG_WAVE.temperature(mirrored))
    shown = {
        ITSELF: frame.temperature,
        AT_ONE: LONG_WAVE.temperature(seen),
        AT_PAINT: jt.object_temperature(seen, PAINT, around),
    }
    spot, off = (
        float(jt.object_temperature(of_patch, SHINY, around + more))
        for more in (0.0, 1.0)
    )
    return Readings(shown, around, spot, off - spot)


def reading_sheet(frame: Frame, read: Readings) -> Image.Image:
    """The surface and readings of it on one scale."""
    true = read.frames[ITSELF]
    low = min(float(values[frame.shiny].mean()) for values in read.frames.values())
    high = float(np.percentile(true[frame.body], 99.5))
    tiles = [
        thermal_tile(
            *(values, frame.body, (low, high), name),
            f"paint {values[frame.paint].mean():.1f} K, "
            f"patch {values[frame.shiny].mean():.1f} K",
        )
        for name, values in read.frames.items()
    ]
    bar = colour_bar(low, high, "temperature [K]")
    title = "What a camera reads of it, with a shiny patch"
    return sheet(tiles, bar, title, columns=len(tiles))


def band_rows(frame: Frame) -> Rows:
    """Means of the radiances on paint and patch, a row for each band."""
    rows = []
    for band, parts in frame.parts.items():
        for name, where in (("paint", frame.paint), ("patch", frame.shiny)):
            means = {n: float(v[where].mean()) for n, v in parts.radiance.items()}
            rows.append({"band": band, "surface": name, **means})
    return rows


def band_table(rows: Rows) -> Table:
    """Table of these rows."""
    names = [name for name in rows[0] if name not in ("band", "surface")]
    columns = [("band", "{band}"), ("surface", "{surface}")]
    columns += [(name, f"{{{name}:.4g}}") for name in names]
    title = "Radiance by what it comes from [W/(m² sr)]"
    return table_of(rows, columns, title, left=(0, 1))

"""One scene with more and more of a camera: the difference that each rung makes."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np
from scipy.ndimage import binary_erosion

import jaxthermo as jt
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.geometry.shapes import figurine
from jaxthermo.image.colour.annotate import write_png
from jaxthermo.image.colour.ticks import to_celsius
from jaxthermo.image.radiance.band import LONG_WAVE
from jaxthermo.image.radiance.image import Image
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.report import page

from ..harness.present import Shot, difference_sheet, publish, table_of, thermal_sheet


QUICK = {"height": 40}

# Height of the figurine [m], and the distance of the camera that sees it [m].
_HEIGHT = 0.3
_DISTANCE = 5.0
# A clear afternoon: air, sky and ground [K], and sun until the frame [W/m^2].
_AIR = 298.15
_SKY = 268.15
_GROUND = 303.15
_SUN = (-0.6, 1.0, -0.9)
_IRRADIANCE = 800.0
_TIMES = (600.0 - 1 / 30, 600.0)
# Painted metal.
_MATERIAL = jt.Material(
    16.0, density=8000.0, specific_heat=500.0, emissivity=0.9, absorptivity=0.6
)
# Width and height of a frame [px]; the pictures show its columns around the body.
_SIZE = (640, 480)
_AROUND = 12
# Pixels from the outline, which mix the body with what is behind it.
_MARGIN = 3
_RUNS = 7


class _Rung(NamedTuple):
    """A way to draw the frame, which differs from the one before in one thing."""

    name: str
    note: str
    band: jt.Band | None = LONG_WAVE
    samples: int = 1
    effects: tuple[Any, ...] = ()
    quantity: str = "apparent_temperature"

    def recording(self, solution: jt.Solution, camera: jt.Camera) -> Iterator[Image]:
        """All frames, drawn this way."""
        return jt.frames(
            solution,
            camera,
            band=self.band,
            samples=self.samples,
            effects=self.effects,
        )


_EFFECTS: tuple[tuple[str, str, Any], ...] = (
    ("angle", "emissivity by the angle", jt.AngularEmissivity()),
    ("gloss", "Phong's lobe, a third", jt.SpecularReflection(1 / 3, 40.0)),
    ("air", f"{_DISTANCE:g} m of humid air", jt.Atmosphere(_AIR, 0.6)),
)
_DETECTOR: tuple[tuple[str, str, Any], ...] = (
    ("diffraction", "f/1, 12 um pixels", jt.DiffractionBlur()),
    ("lag", "bolometer, 10 ms, at 30 Hz", jt.BolometerLag()),
    ("fixed pattern", "20 mK, columns 30 mK", jt.FixedPatternNoise(0.02, 0.03)),
    ("noise", "NETD 50 mK", jt.DetectorNoise(0.05)),
    ("counts", "8 bits, -10 to 90 degC", jt.Counts(263.15, 363.15, bits=8)),
)


def _rungs() -> Iterator[_Rung]:
    yield _Rung("surface", "true temperature", quantity="temperature")
    yield _Rung("all wavelengths", "with all of the sun", band=None)
    yield _Rung("long wave", "7.5 to 14 um")
    effects: tuple[Any, ...] = ()
    for name, note, effect in _EFFECTS:
        effects = (*effects, effect)
        yield _Rung(name, note, effects=effects)
    yield _Rung("2 x 2 samples", "the mean over each pixel", samples=2, effects=effects)
    for name, note, effect in _DETECTOR:
        effects = (*effects, effect)
        yield _Rung(name, note, samples=2, effects=effects)


def _scene(height: int) -> tuple[jt.Solution, jt.Camera]:
    mesh = figurine(_HEIGHT)
    grid = jt.voxelize(mesh, _HEIGHT / height)
    body = jt.Body(jt.FullVolume(grid), _MATERIAL, temperature=_AIR)
    terms = (
        jt.Sun(_SUN, _IRRADIANCE),
        jt.Surroundings(_SKY, ground=_GROUND),
        jt.Convection(8.0, _AIR),
    )
    solution = jt.simulate(jt.Scene((body,), terms), _TIMES[-1], save_at=_TIMES)
    near = frame_all(mesh.triangles, *_SIZE)
    # The same picture by a longer lens: air needs a distance.
    away = np.subtract(near.position, near.look_at)
    factor = _DISTANCE / float(np.linalg.norm(away))
    x, y, z = (float(v) for v in np.asarray(near.look_at) + factor * away)
    angle = 2 * np.arctan(np.tan(near.field_of_view / 2) / factor)
    camera = jt.Camera(
        (x, y, z),
        near.look_at,
        field_of_view=float(angle),
        width=_SIZE[0],
        height=_SIZE[1],
    )
    return solution, camera


def _frame_time(solution: jt.Solution, camera: jt.Camera, rung: _Rung) -> float:
    """Median time of one frame of a recording with the geometry known [ms]."""
    times = []
    for _ in range(_RUNS):
        recording = rung.recording(solution, camera)
        next(recording)
        begin = time.perf_counter()
        _ = next(recording).apparent_temperature
        times.append(1e3 * (time.perf_counter() - begin))
    return float(np.median(times))


class _Row(TypedDict):
    """Mean temperature of a rung, and its difference from the one before it."""

    name: str
    note: str
    mean_K: float
    change_mean_K: float
    change_rms_K: float
    change_max_K: float
    frame_ms: float


class _Result(TypedDict):
    height_voxels: int
    size_px: list[int]
    rungs: list[_Row]
    seed: int
    files: list[str]


def run(folder: Path, height: int = 110) -> _Result:
    """Frames of a figurine of `height` voxels, rung by rung: `report.html`."""
    solution, camera = _scene(height)
    rungs = list(_rungs())
    # The last frame, drawn after the one before it.
    images = [list(rung.recording(solution, camera))[-1] for rung in rungs]
    kelvin = [
        np.asarray(getattr(image, rung.quantity), float)
        for image, rung in zip(images, rungs, strict=True)
    ]
    on_body = np.asarray(images[0].object_id) >= 0
    columns = np.flatnonzero(on_body.any(0))
    leftmost = max(0, int(columns[0]) - _AROUND)
    rightmost = int(columns[-1]) + _AROUND
    cut = slice(leftmost, rightmost)
    inside = np.asarray(binary_erosion(on_body, iterations=_MARGIN), bool)
    rows: list[_Row] = []
    previous_kelvin = kelvin[0]
    for rung, rung_kelvin in zip(rungs, kelvin, strict=True):
        # That of the first rung is zero.
        change = (rung_kelvin - previous_kelvin)[inside]
        rows.append(
            {
                "name": rung.name,
                "note": rung.note,
                "mean_K": float(rung_kelvin[inside].mean()),
                "change_mean_K": float(change.mean()),
                "change_rms_K": float(np.sqrt(np.mean(change**2))),
                "change_max_K": float(np.abs(change).max()),
                "frame_ms": _frame_time(solution, camera, rung),
            }
        )
        previous_kelvin = rung_kelvin
    write_png(
        folder / "rungs.png",
        _frames(rungs, kelvin=kelvin, on_body=on_body, inside=inside, cut=cut),
    )
    write_png(
        folder / "differences.png",
        _differences(rungs, kelvin=kelvin, on_body=on_body, inside=inside, cut=cut),
    )
    publish(folder, "The thermal camera, rung by rung", _sections(rows, folder))
    return {
        "height_voxels": height,
        "size_px": list(_SIZE),
        "rungs": rows,
        "seed": 0,
        "files": ["report.html", "rungs.png", "differences.png"],
    }


def _frames(rungs, kelvin, on_body, inside, cut):
    shots = [
        Shot(k[:, cut] - ZERO_CELSIUS, on_body[:, cut], name=r.name, note=r.note)
        for k, r in zip(kelvin, rungs, strict=True)
    ]
    low, high = np.quantile(kelvin[2][inside], [0.001, 0.999]).tolist()
    return thermal_sheet(
        shots,
        limits=(to_celsius(low), to_celsius(high)),
        scale="temperature shown [\N{DEGREE SIGN}C]",
        title="What a camera shows, with one thing more each time",
    )


def _differences(rungs, kelvin, on_body, inside, cut):
    changes = np.diff(kelvin, axis=0)
    largest = [np.quantile(np.abs(change[inside]), 0.999) for change in changes]
    shots = [
        Shot(c[:, cut], on_body[:, cut], name=r.name, note=r.note)
        for c, r in zip(changes, rungs[1:], strict=True)
    ]
    return difference_sheet(
        shots,
        largest=float(max(largest)),
        scale="change of the temperature shown [K]",
        title="The change that each makes",
    )


def _sections(rows: list[_Row], folder: Path) -> list[page.Section]:
    columns = [
        ("rung", "{name}"),
        ("", "{note}"),
        ("mean [K]", "{mean_K:.3f}"),
        ("mean change [K]", "{change_mean_K:+.3f}"),
        ("rms [K]", "{change_rms_K:.4f}"),
        ("largest [K]", "{change_max_K:.3f}"),
        ("frame [ms]", "{frame_ms:.1f}"),
    ]
    return [
        f"The built-in figurine of painted metal, {_HEIGHT:g} m high, after 10 minutes "
        f"in a sun of {_IRRADIANCE:g} W/m² under a sky of {to_celsius(_SKY):g} °C, on "
        f"ground of {to_celsius(_GROUND):g} °C, in air of {to_celsius(_AIR):g} °C. "
        "Each rung has all those above it. Changes are of the pixels at least "
        f"{_MARGIN} away from the outline, frame times of {_SIZE[0]} x {_SIZE[1]} "
        "pixels of a recording, with the geometry of the view known.",
        table_of(rows, columns, "Rungs of the camera"),
        page.picture(folder / "rungs.png", "frames of all rungs"),
        page.picture(folder / "differences.png", "changes by rung"),
        page.paragraph(
            "A long-wave camera sees a thousandth of the sun that heats the body: over "
            "all wavelengths the lit side looks far too warm. The lag changes next to "
            "nothing, since the body warms slowly; it smears what moves.",
            note=True,
        ),
    ]

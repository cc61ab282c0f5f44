"""Sixty damaged frame sets of the control's frames, seeded, with their configs.

A damage is done to frames in kelvin, as files and a `reference` that say something
else, or to the files alone. Each set is a folder with a `calibration.yaml`.
"""

import copy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from jaxtyping import Float
from PIL import Image

import jaxthermo as jt
from jaxthermo.image.files.exr import write_channels
from jaxthermo.image.radiance.atmosphere import (
    LONG_WAVE_AIR,
    half_path_transmissivity,
)
from tests.flir_jpeg import flir_jpeg


SETS_OF_A_KIND = 12
ZERO_CELSIUS = 273.15
_PLANCK = {"r1": 15900.0, "b": 1415.0, "f": 1.0, "o": -4400.0, "r2": 0.0145}
_SEED = 20261127


class FrameSet(NamedTuple):
    """A damaged frame set, written to a folder."""

    name: str
    config: Path


class _Frames(NamedTuple):
    """Frames [K], and numbers of the pixels that show the body."""

    kelvin: Float[np.ndarray, "2 h w"]
    body: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        _, rows, columns = self.kelvin.shape
        return rows, columns


class _Reference(NamedTuple):
    """What differs in the config's `reference`."""

    files: list[str]
    unit: str | None = None
    mask: str | None = None


_Damage = Callable[[_Frames, Path, np.random.Generator], _Reference]
"""Writes files and tells them in a `reference`."""


def _tiffs(numbers: np.ndarray, folder: Path) -> list[str]:
    names = []
    for n, frame in enumerate(numbers):
        Image.fromarray(np.asarray(frame, np.float32)).save(folder / f"{n}.tiff")
        names.append(f"{n}.tiff")
    return names


def _written(numbers: np.ndarray, folder: Path, unit: str = "kelvin") -> _Reference:
    return _Reference(_tiffs(numbers, folder), unit)


def _in_wrong_unit(convert: Callable[[np.ndarray], np.ndarray], unit: str) -> _Damage:
    def damage(frames: _Frames, folder: Path, rng: np.random.Generator) -> _Reference:
        del rng
        return _written(convert(frames.kelvin), folder, unit)

    return damage


def _celsius(kelvin: np.ndarray) -> np.ndarray:
    return kelvin - ZERO_CELSIUS


def _fahrenheit(kelvin: np.ndarray) -> np.ndarray:
    return 1.8 * kelvin - 459.67


def _one_in_celsius(kelvin: np.ndarray) -> np.ndarray:
    return np.stack([kelvin[0] - ZERO_CELSIUS, kelvin[1]])


def _units() -> Iterator[tuple[str, _Damage]]:
    table: list[tuple[str, Callable[[np.ndarray], np.ndarray], str]] = [
        ("kelvin as celsius", np.asarray, "celsius"),
        ("celsius as kelvin", _celsius, "kelvin"),
        ("celsius as centikelvin", _celsius, "centikelvin"),
        ("kelvin as centikelvin", np.asarray, "centikelvin"),
        ("centikelvin as kelvin", lambda kelvin: 100 * kelvin, "kelvin"),
        ("fahrenheit as celsius", _fahrenheit, "celsius"),
        ("fahrenheit as kelvin", _fahrenheit, "kelvin"),
        ("tenths of kelvin as centikelvin", lambda kelvin: 10 * kelvin, "centikelvin"),
        ("rankine as kelvin", lambda kelvin: 1.8 * kelvin, "kelvin"),
        ("one frame in celsius", _one_in_celsius, "celsius"),
        ("zero of 273 K", lambda kelvin: kelvin - 0.15, "kelvin"),
        (
            "counts of 0.04 K as centikelvin",
            lambda kelvin: kelvin / 0.04,
            "centikelvin",
        ),
    ]
    for name, convert, unit in table:
        yield name, _in_wrong_unit(convert, unit)


def _dead_pixels(value: float | None) -> _Damage:
    """One to four pixels of the body; None for what they show in the first frame."""

    def damage(frames: _Frames, folder: Path, rng: np.random.Generator) -> _Reference:
        dead = rng.choice(frames.body, rng.integers(1, 5), replace=False)
        numbers = frames.kelvin.reshape(2, -1).copy()
        if value is None:
            numbers[1, dead] = numbers[0, dead]
        else:
            in_both = rng.integers(2)
            numbers[0 if in_both else 1 :, dead] = value
        return _written(numbers.reshape(frames.kelvin.shape), folder)

    return damage


def _dead() -> Iterator[tuple[str, _Damage]]:
    values = (0.0, 233.15, 273.15, 293.15, 296.0, 298.0, 300.0, 330.0, 500.0, np.nan)
    for value in values:
        yield f"dead pixels at {value:g} K", _dead_pixels(value)
    yield "dead pixels that are infinite", _dead_pixels(np.inf)
    yield "dead pixels that stay", _dead_pixels(None)


def _rearranged(change: Callable[[np.ndarray], np.ndarray]) -> _Damage:
    def damage(frames: _Frames, folder: Path, rng: np.random.Generator) -> _Reference:
        del rng
        return _written(change(frames.kelvin), folder)

    return damage


def _orders() -> Iterator[tuple[str, _Damage]]:
    def fields(frames: np.ndarray) -> np.ndarray:
        return frames.reshape(2, -1, 2, frames.shape[2])[:, :, ::-1].reshape(
            frames.shape
        )

    table: list[tuple[str, Callable[[np.ndarray], np.ndarray]]] = [
        ("last frame first", lambda frames: frames[::-1]),
        ("first frame twice", lambda frames: frames[[0, 0]]),
        ("last frame twice", lambda frames: frames[[1, 1]]),
        ("mirrored", lambda frames: frames[:, :, ::-1]),
        ("upside down", lambda frames: frames[:, ::-1]),
        ("turned by half a turn", lambda frames: frames[:, ::-1, ::-1]),
        ("turned by a quarter", lambda frames: frames.transpose(0, 2, 1)),
        ("a column off", lambda frames: np.roll(frames, 1, axis=2)),
        ("a row off", lambda frames: np.roll(frames, -1, axis=1)),
        ("rows of fields exchanged", fields),
        ("second frame mirrored", lambda f: np.stack([f[0], f[1][:, ::-1]])),
        ("three frames", lambda frames: frames[[0, 0, 1]]),
    ]
    for name, change in table:
        yield name, _rearranged(change)


def _mask(keep: np.ndarray, size: tuple[int, int], folder: Path) -> str:
    picture = np.zeros(size, np.uint8)
    picture.reshape(-1)[keep] = 255
    Image.fromarray(picture).save(folder / "mask.png")
    return "mask.png"


def _masked(part: float, dead: float | None = None, count: int = 0) -> _Damage:
    """Keep a part of the body's pixels; the others are `dead`, or `count` kept ones."""

    def damage(frames: _Frames, folder: Path, rng: np.random.Generator) -> _Reference:
        kept = rng.choice(frames.body, round(part * len(frames.body)), replace=False)
        numbers = frames.kelvin.reshape(2, -1).copy()
        if dead is not None:
            wrong = kept[:count] if count else np.setdiff1d(frames.body, kept)
            numbers[:, wrong] = dead
        reference = _written(numbers.reshape(frames.kelvin.shape), folder)
        return reference._replace(mask=_mask(kept, frames.size, folder))

    return damage


def _mask_of(pixels: Callable[[_Frames], np.ndarray], turned: bool = False) -> _Damage:
    def damage(frames: _Frames, folder: Path, rng: np.random.Generator) -> _Reference:
        del rng
        rows, columns = frames.size
        size = (columns, rows) if turned else frames.size
        reference = _written(frames.kelvin, folder)
        return reference._replace(mask=_mask(pixels(frames), size, folder))

    return damage


def _masks() -> Iterator[tuple[str, _Damage]]:
    yield "mask of nine tenths", _masked(0.9)
    yield "mask of two thirds", _masked(0.65)
    yield "mask of a half", _masked(0.5)
    yield "mask of a fifth", _masked(0.2)
    yield "mask that hides pixels of 0 K", _masked(0.5, dead=0.0)
    yield "mask that hides pixels of 500 K", _masked(0.5, dead=500.0)
    yield "mask that hides pixels that are no number", _masked(0.5, dead=np.nan)
    yield "mask with a pixel of 303 K in it", _masked(0.5, dead=303.0, count=1)
    yield (
        "inverted mask",
        _mask_of(lambda f: np.setdiff1d(np.arange(f.kelvin[0].size), f.body)),
    )
    yield "empty mask", _mask_of(lambda frames: frames.body[:0])
    yield "mask of another size", _mask_of(lambda frames: frames.body, turned=True)
    yield "mask of two pixels", _mask_of(lambda frames: frames.body[:2])


def _counts(kelvin: np.ndarray, settings: dict[str, float]) -> np.ndarray:
    """Counts of a camera behind half the air, a window, and half the air again.

    Source: FLIR's formula as in gtatters/Thermimage, `temp2raw` with a window half way.
    """
    constants = {name: settings[name] for name in _PLANCK}
    camera = jt.FlirCalibration(**constants)
    passed = float(
        half_path_transmissivity(
            np.asarray(settings["distance"]),
            temperature=np.asarray(settings["air_temperature"]),
            relative_humidity=settings["relative_humidity"],
            xp=np,
            constants=LONG_WAVE_AIR,
        )
    )
    window = settings["window_transmissivity"]
    air = float(camera.counts(settings["air_temperature"]))
    glass = float(camera.counts(settings["window_temperature"]))
    behind = passed * np.asarray(camera.counts(kelvin)) + (1 - passed) * air
    before = window * behind + (1 - window) * glass
    return np.rint(passed * before + (1 - passed) * air).astype(int)


def _flir(**changed: float) -> _Damage:
    """JPEG files that state what stands between the camera and the body."""

    def damage(frames: _Frames, folder: Path, rng: np.random.Generator) -> _Reference:
        settings = {
            **_PLANCK,
            "emissivity": 1.0,
            "distance": 0.0,
            "reflected_temperature": 293.15,
            "air_temperature": float(rng.uniform(270, 300)),
            "window_temperature": float(rng.uniform(270, 300)),
            "window_transmissivity": 1.0,
            "relative_humidity": 0.5,
            "alpha1": LONG_WAVE_AIR.alpha1,
            "alpha2": LONG_WAVE_AIR.alpha2,
            "beta1": LONG_WAVE_AIR.beta1,
            "beta2": LONG_WAVE_AIR.beta2,
            "x": LONG_WAVE_AIR.x,
        } | changed
        files = []
        for n, kelvin in enumerate(frames.kelvin):
            data = flir_jpeg(_counts(kelvin, settings), settings)
            (folder / f"{n}.jpg").write_bytes(data)
            files.append(f"{n}.jpg")
        return _Reference(files)

    return damage


def _exr_in_celsius(
    frames: _Frames, folder: Path, rng: np.random.Generator
) -> _Reference:
    del rng
    files = []
    for n, kelvin in enumerate(frames.kelvin):
        channels = {"apparent_temperature": _celsius(kelvin).astype(np.float32)}
        write_channels(folder / f"{n}.exr", channels)
        files.append(f"{n}.exr")
    return _Reference(files, "celsius")


def _table(decimal: str, separator: str, header: str) -> _Damage:
    """CSV files of a camera's software, in degrees Celsius."""

    def damage(frames: _Frames, folder: Path, rng: np.random.Generator) -> _Reference:
        del rng
        files = []
        for n, kelvin in enumerate(frames.kelvin):
            rows = [
                separator.join(f"{c:.3f}".replace(".", decimal) for c in row)
                for row in _celsius(kelvin)
            ]
            text = header + "\n".join(rows) + "\n"
            (folder / f"{n}.csv").write_bytes(text.encode("latin-1"))
            files.append(f"{n}.csv")
        return _Reference(files, "celsius")

    return damage


def _arrays_of_float64(
    frames: _Frames, folder: Path, rng: np.random.Generator
) -> _Reference:
    del rng
    np.save(folder / "0.npy", frames.kelvin[0])
    np.save(folder / "1.npy", frames.kelvin[1])
    return _Reference(["0.npy", "1.npy"], "kelvin")


def _settings() -> Iterator[tuple[str, _Damage]]:
    yield "counts and their constants", _flir()
    yield "a window", _flir(window_transmissivity=0.85)
    yield "a dark window", _flir(window_transmissivity=0.6)
    yield "air over 30 m", _flir(distance=30.0)
    yield "air and a window", _flir(distance=10.0, window_transmissivity=0.9)
    yield "an emissivity of 0.95", _flir(emissivity=0.95)
    yield "an emissivity of 0.5", _flir(emissivity=0.5, reflected_temperature=280.0)
    yield "other constants", _flir(r1=17500.0, b=1500.0, o=-6000.0, r2=0.012)
    yield "celsius in EXR files", _exr_in_celsius
    yield "celsius in a table", _table(",", ";", "Datei: Bild\nEinheit: \xb0C\n")
    yield "celsius behind tabs", _table(".", "\t", "")
    yield "arrays of float64", _arrays_of_float64


def damaged_sets(
    control: Path, kelvin: np.ndarray, body: np.ndarray, folder: Path
) -> list[FrameSet]:
    """Write all sets to folders.

    Args:
        control: folder of the control, with its config and scene.
        kelvin: the control's frames [time, row, column].
        body: numbers of the pixels that show the body.
        folder: for the folders of the sets.
    """
    config = yaml.safe_load((control / "calibration.yaml").read_text())
    config["scene"] = str((control / "scene.yaml").resolve())
    config["fit"] = {"max_steps": 50}
    kinds = (_units, _dead, _orders, _masks, _settings)
    damages = [damage for kind in kinds for damage in kind()]
    sets = []
    for number, (name, damage) in enumerate(damages):
        place = folder / f"{number:02d}"
        place.mkdir()
        rng = np.random.default_rng([_SEED, number])
        changed = damage(_Frames(kelvin, body), place, rng)
        damaged = copy.deepcopy(config)
        reference = damaged["reference"]
        reference["frames"][0]["files"] = changed.files
        settings = {"unit": changed.unit, "mask": changed.mask}
        reference.pop("unit")
        reference |= {key: value for key, value in settings.items() if value}
        path = place / "calibration.yaml"
        path.write_text(yaml.safe_dump(damaged))
        sets.append(FrameSet(name, path))
    return sets

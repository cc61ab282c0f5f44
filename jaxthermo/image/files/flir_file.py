"""Radiometric JPEG files of FLIR cameras: raw counts and what they mean.

Such a file is a picture to look at with the counts of the detector, the constants of
the camera and the settings of its user inside. They are read by the package flyr.
"""

import importlib.util
from pathlib import Path
from typing import Any, NamedTuple

import lazy_loader
import numpy as np
from jaxtyping import Float, Int

from ...errors import InputError, located, shortened
from ..radiance.thermography import FlirCalibration


# An extra of this package.
_flyr: Any = lazy_loader.load("flyr")

# Kinds of records in a file (exiftool.org/TagNames/FLIR.html).
_RAW_DATA = 0x01
_CAMERA_INFO = 0x20


class FlirThermogram(NamedTuple):
    """Counts of a FLIR camera with its constants, and the settings of its user.

    Example:
        >>> import jaxthermo as jt
        >>> import numpy as np
        >>> seen = jt.FlirThermogram(
        ...     np.full((2, 2), 18109), jt.FlirCalibration(), emissivity=0.95
        ... )
        >>> float(seen.object_temperature()[0, 0].round(2))
        296.95
    """

    counts: Int[np.ndarray, "h w"]
    """Raw counts S of the detector."""
    calibration: FlirCalibration
    """Constants of this camera."""
    emissivity: float = 1.0
    """Emissivity of the object [-], as set at the camera, like all that follows."""
    reflected_temperature: float = 293.15
    """Temperature of what the object reflects [K]."""
    distance: float = 0.0
    """Distance of the object [m]."""
    air_temperature: float = 293.15
    """Temperature of the air between [K]."""
    relative_humidity: float = 0.5
    """Humidity of this air, 0 to 1."""
    window_transmissivity: float = 1.0
    """Transmissivity of a window in front of the camera [-]."""
    window_temperature: float = 293.15
    """Temperature of the window [K]."""

    def apparent_temperature(self) -> Float[np.ndarray, "h w"]:
        """Temperature of a black surface right before the camera [K]."""
        return np.asarray(self.calibration.temperature(self.counts))

    def object_temperature(self, **settings: float) -> Float[np.ndarray, "h w"]:
        """Temperature of the object [K], with the camera's settings or others.

        Raises:
            InputError: as `FlirCalibration.object_temperature`, and for settings of
                other names.
        """
        stored_settings = {name: getattr(self, name) for name in self._fields[2:]}
        for name in settings.keys() - stored_settings.keys():
            raise InputError(
                f"FlirThermogram.object_temperature({name}=...): settings are "
                f"{', '.join(stored_settings)}"
            )
        kelvin = self.calibration.object_temperature(
            self.counts, **stored_settings | settings
        )
        return np.asarray(kelvin)


def read_flir(path: str | Path) -> FlirThermogram:
    """Read a radiometric JPEG of a FLIR camera.

    Raises:
        InputError: for a file that is missing, damaged or a mere picture, or without
            the package flyr.
    """
    path = Path(path)
    if importlib.util.find_spec("flyr") is None:
        raise InputError(
            f"{path}: frames of FLIR cameras need the package flyr: run pip install "
            '"jaxthermo[flir]"'
        )
    if not path.is_file():
        raise InputError(f"{path} is not a file: give the path of a frame")
    try:
        # Part by part, since the whole does not give the counts away.
        with path.open("rb") as file:
            data = _flyr.records.extract_flir_app1(file)
        records = _flyr.records.parse_flir_records(data)
        raw = _flyr.thermal.parse_camera_info(data, records[_CAMERA_INFO])
        _, _, counts = _flyr.thermal.parse_raw_data(data, records[_RAW_DATA])
    except Exception as error:  # bytes of other files make the reader raise anything
        raise InputError(
            f"{path}: no counts of a FLIR camera in it ({shortened(error)}): give the "
            "file that the camera wrote, not a picture exported from it"
        ) from error
    constants = {name: raw[f"planck_{name}"] for name in ("r1", "b", "f", "o", "r2")}
    humidity = raw["relative_humidity"]
    with located(str(path)):
        calibration = FlirCalibration(**{k: float(v) for k, v in constants.items()})
    return FlirThermogram(
        counts=np.asarray(counts, np.int64),
        calibration=calibration,
        emissivity=raw["emissivity"],
        reflected_temperature=raw["reflected_apparent_temperature"],
        distance=raw["object_distance"],
        air_temperature=raw["atmospheric_temperature"],
        # Some cameras write per cent.
        relative_humidity=humidity / 100 if humidity > 2 else humidity,
        window_transmissivity=raw["ir_window_transmission"],
        window_temperature=raw["ir_window_temperature"],
    )

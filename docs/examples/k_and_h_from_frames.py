"""Conductivity and heat transfer coefficient from frames of a thermal camera.

python docs/examples/k_and_h_from_frames.py [--out results/k-and-h]

The frames are made here, with known values, on finer voxels and with noise, and are
written as TIFF files in degrees Celsius, as a camera's software does. The calibration
knows the files, the camera and the noise; replace the files by your own. Its voxels are
twice as coarse: where the residuals show more than the noise, standard errors are as
much wider, and the first line of the results says so.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

import jaxthermo as jt


TRUE = {"conductivity": 20.0, "coefficient": 30.0}
POSITION = (-0.5, -0.6, 0.4)
LOOK_AT = (0.0, 0.0, 0.05)
NOISE = 0.05  # standard deviation of a pixel [K]
ZERO_CELSIUS = 273.15


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/k-and-h"))
    parser.add_argument("--quick", action="store_true", help="small, for a test")
    options = parser.parse_args()
    size = (32, 24) if options.quick else (96, 72)
    times = [60, 240] if options.quick else [30, 60, 120, 240]
    options.out.mkdir(parents=True, exist_ok=True)
    files = write_frames(options.out, times, size)
    config = write_calibration(options.out, files=files, times=times, size=size)
    fit = options.out / "fit"
    command = [sys.executable, "-m", "calibrate", "fit", str(config), "--out", str(fit)]
    subprocess.run(command, check=True)
    print(f"true values: {TRUE}")
    for name, estimate in read_fit(fit).items():
        print(f"{name}: {estimate['value']:.4g} +- {estimate['standard_error']:.2g}")


def write_frames(folder: Path, times: list[int], size: tuple[int, int]) -> list[str]:
    """What a camera would write: a TIFF file of each time, in degrees Celsius."""
    steel = jt.Material(
        TRUE["conductivity"], density=8000.0, specific_heat=500.0, emissivity=0.95
    )
    grid = jt.voxelize(jt.shapes.box((0.08, 0.06, 0.1)), pitch=2e-3)
    body = jt.Body(jt.FullVolume(grid), steel, temperature=293.15)
    terms = (
        jt.Sun((1.0, 0.5, -0.5), jt.Until(5000.0, 120.0)),
        jt.Convection(TRUE["coefficient"], 293.15),
        jt.Surroundings(temperature=280.0),
    )
    solution = jt.simulate(jt.Scene((body,), terms), times[-1], save_at=times)
    camera = jt.Camera(POSITION, LOOK_AT, width=size[0], height=size[1])
    random = np.random.default_rng(1)
    names = []
    for index, time in enumerate(times):
        image = jt.render(solution, camera, index=index, band=None)
        celsius = np.asarray(image.apparent_temperature) - ZERO_CELSIUS
        celsius += NOISE * random.standard_normal(celsius.shape)
        names.append(f"frame_{time:04d}s.tiff")
        Image.fromarray(celsius.astype(np.float32)).save(folder / names[-1])
    return names


def write_calibration(
    folder: Path, files: list[str], times: list[int], size: tuple[int, int]
) -> Path:
    """The scene with first guesses, and what is to be fitted to the frames."""
    scene = {
        "bodies": [
            {
                "shape": {"kind": "box", "size": ["8 cm", "6 cm", "10 cm"]},
                "pitch": "4 mm",
                "material": {
                    "conductivity": "12 W/(m K)",
                    "density": "8000 kg/m^3",
                    "specific_heat": "500 J/(kg K)",
                    "emissivity": 0.95,
                },
                "temperature": "20 degC",
            }
        ],
        "terms": [
            {
                "kind": "sun",
                "direction": [1, 0.5, -0.5],
                "irradiance": "5 kW/m^2",
                "until": "120 s",
            },
            {
                "kind": "convection",
                "heat_transfer_coefficient": 15,
                "temperature": "20 degC",
            },
            {"kind": "surroundings", "temperature": "280 K"},
        ],
        "time": {"end": times[-1], "save_at": times},
        "image": {"band": None},
    }
    view = {
        "kind": "pinhole",
        "position": list(POSITION),
        "look_at": list(LOOK_AT),
        "width": size[0],
        "height": size[1],
    }
    calibration = {
        "scene": "scene.yaml",
        "train": [{"name": "frames"}],
        "reference": {
            "kind": "frames",
            "frames": [{"case": "frames", "view": 0, "files": files}],
            "views": [view],
            "unit": "celsius",
            "noise": NOISE,
        },
        "parameters": [
            {"name": "material.conductivity"},
            {"name": "convection.heat_transfer_coefficient"},
        ],
    }
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    path = folder / "calibration.yaml"
    path.write_text(yaml.safe_dump(calibration))
    return path


def read_fit(folder: Path) -> dict[str, dict[str, float]]:
    """Values and standard errors of the parameters by name."""
    fitted = json.loads((folder / "fit.json").read_text())["parameters"]
    return {
        name: {key: estimate[key] for key in ("value", "standard_error")}
        for name, estimate in fitted.items()
    }


if __name__ == "__main__":
    main()

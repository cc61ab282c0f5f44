"""A mesh of your own, or the built-in figurine, to a thermal video.

python docs/examples/mesh_to_video.py [statue.ply --unit mm --up z] [--out video.png]

The video is an animated PNG, which browsers show; with `--out video.mp4` and the extra
`video` it is an MP4.
"""

import argparse
from pathlib import Path

import numpy as np

import jaxthermo as jt


def main() -> None:
    options = parse()
    size = 64 if options.quick else 160  # voxels along the longest edge
    mesh = (
        jt.load_mesh(options.mesh, unit=options.unit, up=options.up)
        if options.mesh
        else jt.shapes.figurine(0.3)
    )
    low, high = mesh.bounds
    extent = (high - low).max()
    middle = (low + high) / 2
    grid = jt.voxelize(mesh, pitch=extent / size)
    print(f"{grid.solid_count} voxels of {1e3 * grid.pitch:.2f} mm")

    clay = jt.Material(1.0, density=1900.0, specific_heat=835.0, emissivity=0.95)
    body = jt.Body(jt.Aggregate(grid, factor=2), clay, temperature=293.15)
    terms = (
        jt.Sun((-0.55, 0.6, -0.75), jt.Until(1000.0, 300.0)),  # then shade
        jt.Convection(10.0, 293.15),
        jt.Surroundings(temperature=283.15),
    )
    times = np.linspace(0.0, 600.0, 6 if options.quick else 41)
    solution = jt.simulate(jt.Scene((body,), terms), 600.0, save_at=times.tolist())

    eye = middle + extent * np.array((0.6, -2.4, 0.3))
    camera = jt.Camera(tuple(eye), tuple(middle), width=240, height=320)
    kelvin = np.asarray(solution.surface_temperature)
    images = [
        jt.picture(frame, float(kelvin.min()), float(kelvin.max()))
        for frame in jt.frames(solution, camera)
    ]
    jt.write_animation(options.out, images)
    print(f"{len(images)} frames in {options.out}")


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("mesh", nargs="?", type=Path)
    parser.add_argument("--unit", default="mm")
    parser.add_argument("--up", default="z")
    parser.add_argument("--out", type=Path, default=Path("video.png"))
    parser.add_argument("--quick", action="store_true", help="small, for a test")
    return parser.parse_args()


if __name__ == "__main__":
    main()

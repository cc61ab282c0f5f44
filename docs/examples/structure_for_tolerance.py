"""The fastest structure of a body whose error is within a tolerance.

python docs/examples/structure_for_tolerance.py --tolerance 2

Every structure is run in coarse and fine voxels, compared with finer voxels still, and
timed. The error of the finest voxels themselves counts too. `calibrate plan` searches
more choices, with fewer runs, for any scene file.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import jaxthermo as jt


STRUCTURES: dict[str, Callable[[jt.VoxelGrid], Any]] = {
    "full volume": jt.FullVolume,
    "octree": jt.Octree,
    "shell over core": jt.ShellOverCore,
    "blocks x2": lambda grid: jt.Aggregate(grid, factor=2),
    "blocks x4": lambda grid: jt.Aggregate(grid, factor=4),
}
SAVE_AT = [30.0, 60.0, 120.0]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tolerance", type=float, default=2.0, help="percent of range")
    parser.add_argument("--quick", action="store_true", help="small, for a test")
    options = parser.parse_args()
    heights = (48,) if options.quick else (64, 96)

    mesh = jt.shapes.figurine(0.3)
    finest = 2 * heights[-1]
    references = (finest, finest // 2, finest // 4)
    grids = {n: jt.voxelize(mesh, 0.3 / n) for n in {*heights, *references}}
    reference, middle, coarsest = [
        jt.simulate(scene_of(jt.Aggregate(grids[n], factor=2)), 120.0, SAVE_AT)
        for n in references
    ]
    own_errors = jt.discretization_error(reference, middle, coarsest)
    own_error = own_errors.rms_percent.max()
    choices = []
    print("voxels high  structure         nodes    error       run")
    for high in heights:
        for name, structure in STRUCTURES.items():
            body_structure = structure(grids[high])
            solution, seconds = timed(scene_of(body_structure))
            error = jt.truth_error(solution, reference).worst_rms_percent
            choices.append((seconds, error, name, high))
            print(
                f"{high:11}  {name:15} {body_structure.node_count:7}  {error:6.2f} %"
                f"  {1e3 * seconds:6.1f} ms"
            )
    print(f"the reference itself is off by about {own_error:.2f} %")
    within = [c for c in choices if c[1] + own_error <= options.tolerance]
    if not within:
        nearest = min(error for _, error, _, _ in choices) + own_error
        print(f"none within {options.tolerance} %: the nearest {nearest:.2f} %")
        return
    seconds, error, name, high = min(within)
    total = error + own_error
    print(f"take {name}, {high} voxels high: {total:.2f} % in {1e3 * seconds:.1f} ms")


def scene_of(structure) -> jt.Scene:
    steel = jt.materials["stainless_steel"]
    body = jt.Body(structure, steel, temperature=293.15)
    sun = jt.Sun((-1.0, 0.0, 0.0), 5000.0)
    air = jt.Convection(10.0, 293.15)
    return jt.Scene((body,), (sun, air))


def timed(scene: jt.Scene) -> tuple[jt.Solution, float]:
    """The solution, and the shortest of three times of the compiled run [s]."""
    run = jt.compile_simulation(scene, 120.0, SAVE_AT)
    solution = run()
    times = []
    for _ in range(3):
        start = time.perf_counter()
        jax.block_until_ready(run().surface_temperature)
        times.append(time.perf_counter() - start)
    return solution, float(np.min(times))


if __name__ == "__main__":
    main()

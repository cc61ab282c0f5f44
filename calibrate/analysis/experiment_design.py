"""Ranking of runs and save times that might be measured too, by D-optimality.

Their residuals' derivatives follow from the model at the fitted values; no data are
needed.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.accuracy.surface_error import error_span
from jaxthermo.arrays import precision
from jaxthermo.config.schema.image import CameraConfig
from jaxthermo.integrate.run.parametric_run import ParametricRun, ParametricSolution
from jaxthermo.scene.scene import Scene

from ..config.fit_record import Advice
from ..config.schema import CalibrationConfig
from ..problem.build import Calibration
from ..problem.frame_source import camera_views
from ..problem.problem import trace
from ..problem.reference import Log
from ..problem.targets import FrameTarget
from ..solvers.fit import Fit
from ..solvers.levenberg_marquardt import jacobian_rows
from .identifiability import information_gain


_Measurement = Callable[[Scene, ParametricSolution], Float[Array, "t r"]]
"""Measured values of a run [standard deviations], one row per time."""


def rank_experiments(
    config: CalibrationConfig, calibration: Calibration, fit: Fit, sd: float, log: Log
) -> list[Advice]:
    """Further runs and save times, the most informative first."""
    # Too many coordinates to compare information matrices.
    if fit.jacobian is None:
        return []
    jacobian = fit.jacobian / sd
    ranking: list[Advice] = []

    def add(description: str, rows: Float[np.ndarray, "p r"]) -> None:
        gain = information_gain(jacobian, further=rows)
        ranking.append({"what": description, "gain_nats": gain})

    def rows_per_time(
        scene: Scene, times: tuple[float, ...], cameras: tuple[CameraConfig, ...] = ()
    ) -> list[Float[np.ndarray, "p r"]]:
        measure = _measurement(
            calibration, cameras=cameras, scene=scene, times=times, sd=sd
        )
        return _rows_per_time(
            calibration, fit=fit, scene=scene, times=times, measure=measure
        )

    for candidate in config.candidates:
        log(f"{candidate.name}: information it would add")
        rows = rows_per_time(
            calibration.scenes[candidate.name],
            times=calibration.configs[candidate.name].time.save_times,
            cameras=candidate.views,
        )
        add(candidate.name, np.concatenate(rows, 1))
    for case in calibration.train.cases:
        log(f"{case.name}: information of other save times")
        # The middle of every span between save times, the first from 0.
        ends = np.array([0.0, *case.run.save_times])
        times = tuple((0.5 * (ends[1:] + ends[:-1])).tolist())
        for time, rows in zip(times, rows_per_time(case.scene, times), strict=True):
            add(f"{case.name}, saved at {time:g} s too", rows)
    return sorted(ranking, key=lambda entry: -entry["gain_nats"])


def _measurement(
    calibration: Calibration,
    cameras: tuple[CameraConfig, ...],
    scene: Scene,
    times: tuple[float, ...],
    sd: float,
) -> _Measurement:
    # The same kind of data, with the same noise, as the fit's.
    target = calibration.train.cases[0].target
    cases = len(calibration.train.cases)
    if isinstance(target, FrameTarget):
        views = camera_views(cameras, scene) if cameras else target.views

        def pixels(scene: Scene, solution: ParametricSolution) -> Float[Array, "t r"]:
            return target.measure(views, scene=scene, solution=solution, times=times)

        return pixels
    # As `SurfaceTarget`, but relative to the range of the run itself.
    count = len(target.times)

    def surface(scene: Scene, solution: ParametricSolution) -> Float[Array, "t r"]:
        del scene
        area = np.concatenate([s.geometry.fragment_area for s in solution.surfaces])
        temperature = solution.surface_temperature
        weight = jnp.asarray(np.sqrt(area / area.sum())[None], temperature.dtype)
        span = error_span(temperature)[:, None]
        return 100 / (sd * (count * cases) ** 0.5) * weight * temperature / span

    return surface


def _rows_per_time(
    calibration: Calibration,
    fit: Fit,
    scene: Scene,
    times: tuple[float, ...],
    measure: _Measurement,
) -> list[Float[np.ndarray, "p r"]]:
    problem = calibration.train
    with precision(problem.dtype.name):
        z = jnp.asarray(fit.z, problem.dtype)
        run = ParametricRun(times, problem.cases[0].run.solver)
        longest = run.longest_step(problem.parameters.insert(scene, z))
        table = run.divided(run.fewest_steps(scene), longest=float(longest))

        def measured(z, table):
            changed = problem.parameters.insert(scene, z)
            measurement = measure(changed, run(changed, table))
            # The integer takes the place of the diagnostics, and has no tangent.
            return measurement.reshape(-1), jnp.zeros((), jnp.int32)

        traced = trace(measured, z, table)
        jacobian = jacobian_rows(traced, args=table, z=z, batch=problem.batch())
        rows = np.asarray(jacobian, float)
    return list(np.moveaxis(rows.reshape(len(rows), len(times), -1), 1, 0))

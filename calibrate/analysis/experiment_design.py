"""What more to measure: which further run, view or save time would tell most.

By D-optimality, from the derivatives of what would be seen. No data of it are needed:
at the values that were found the model says what it would be.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.arrays import precision
from jaxthermo.integrate.run.parametric_run import Answer, Response
from jaxthermo.integrate.surface_error import error_span
from jaxthermo.scene.scene import Scene

from ..config.schema import CalibrationConfig
from ..problem.build import Built
from ..problem.problem import call, jacobian_rows
from ..problem.reference import Doing
from ..problem.thermogram_targets import FrameTarget, seen_in
from ..solvers.fit import Fit
from ..solvers.jaxpr_function import trace
from .identifiability import information_gain


Seen = Callable[[Scene, Answer], Float[Array, "t r"]]
"""What would be measured of a run, in standard deviations, a row a time."""


def advise(
    config: CalibrationConfig, built: Built, fit: Fit, sd: float, doing: Doing
) -> list[dict[str, Any]]:
    """Further runs and save times, those first that tell most.

    Args:
        config: of the calibration.
        built: its problems.
        fit: what was found.
        sd: standard deviation of a misfit.
        doing: is told what takes a while.
    """
    if fit.jacobian is None:
        return []
    known, found = fit.jacobian / sd, []
    gain = lambda rows: information_gain(known, rows, 1.0)
    for given in config.further:
        doing(f"{given.name}: what it would tell")
        scene = built.scenes[given.name]
        saves = built.configs[given.name].time.save_times
        rows = _rows(
            built, fit, scene, saves, _measured(built, given.views, scene, saves, sd)
        )
        found.append({"what": given.name, "gain_nats": gain(np.concatenate(rows, 1))})
    for case in built.train.cases:
        doing(f"{case.name}: what other save times would tell")
        times = between(case.response.saves)
        seen = _measured(built, (), case.scene, times, sd)
        for time, rows in zip(
            times, _rows(built, fit, case.scene, times, seen), strict=True
        ):
            what = f"{case.name}, saved at {time:g} s too"
            found.append({"what": what, "gain_nats": gain(rows)})
    return sorted(found, key=lambda entry: -entry["gain_nats"])


def between(saves: tuple[float, ...]) -> tuple[float, ...]:
    """The middle of every span between save times, the first from 0 [s]."""
    ends = np.array([0.0, *saves])
    return tuple((0.5 * (ends[1:] + ends[:-1])).tolist())


def _measured(built: Built, views, scene: Scene, saves, sd: float) -> Seen:
    """As the data of the fit are."""
    target, cases = built.train.cases[0].target, len(built.train.cases)
    if isinstance(target, FrameTarget):
        own = built.views(views, scene) if views else target.views
        return lambda scene, answer: seen_in(own, target, scene, answer, saves)
    times = len(target.moments)

    def surface(scene: Scene, answer: Answer) -> Float[Array, "t r"]:
        del scene
        area = np.concatenate([s.geometry.fragment_area for s in answer.surfaces])
        share = jnp.asarray(np.sqrt(area / area.sum())[None], answer.surface.dtype)
        span = error_span(answer.surface)[:, None]
        return 100 / (sd * (times * cases) ** 0.5) * share * answer.surface / span

    return surface


def _rows(
    built: Built, fit: Fit, scene: Scene, saves: tuple[float, ...], seen: Seen
) -> list[Float[np.ndarray, "p r"]]:
    """Derivatives of what would be seen by the free numbers, an array a time."""
    problem = built.train
    with precision(problem.dtype.name):
        z = jnp.asarray(fit.z, problem.dtype)
        at = problem.parameters.put(scene, z)
        response = Response(saves, problem.cases[0].response.solver)
        longest = None
        if response.follows_stability:
            # Laid out for the scene as given, which may be the stiffer one.
            longest = min(float(response.stable_step(s)) for s in (at, scene))
        layout = response.layout(scene, longest)

        def look(z, layout):
            own = problem.parameters.put(scene, z)
            found = seen(own, response(own, layout))
            return found.reshape(-1), jnp.zeros((), jnp.int32)

        program = trace(look, z, layout), layout
        rows = np.asarray(jacobian_rows(call, program, z, problem.batch()), float)
    return list(np.moveaxis(rows.reshape(len(rows), len(saves), -1), 1, 0))

"""Errors that all pixels share, which no residual shows: gain and emissivity.

A factor 1 + e on all radiances, or on all emissivities, of the declared relative
standard deviation s_e, moves the residuals by u e with u = dr/de, and the values of a
fit by -(J^T J)^-1 J^T u e. The gradient's covariance gains

    s_e^2 (J^T u) (J^T u)^T.

Source: Schmidt, Advances in Control Systems 3 (1966) 293-340: parameters that are
considered and not estimated.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.image.radiance.band import Band, black_radiance
from jaxthermo.scene.scene import Body, Scene
from jaxthermo.structures.kinds.sheet import Sheet

from ..config.schema import CalibrationConfig, FramesConfig
from ..problem.parameters import Path, value_at, with_values
from ..problem.problem import Problem, trace
from ..problem.targets import FrameTarget
from ..solvers.levenberg_marquardt import jacobian_rows


def declared(config: CalibrationConfig) -> dict[str, float]:
    """Declared relative standard deviations above 0, by what they are of."""
    reference = config.reference
    if not isinstance(reference, FramesConfig):
        return {}
    deviations = {
        "gain": reference.gain_uncertainty,
        "emissivity": reference.emissivity_uncertainty,
    }
    return {name: sd for name, sd in deviations.items() if sd > 0}


def check_declared(config: CalibrationConfig) -> None:
    """Refuse an uncertainty of an emissivity that is fitted.

    Raises:
        InputError: if an emissivity is a parameter.
    """
    if "emissivity" not in declared(config):
        return
    for parameter in config.parameters:
        for name in (parameter.name, *parameter.tied):
            if "emissivity" in name.split("."):
                raise InputError(
                    f"reference: emissivity_uncertainty: {name} is fitted, so that its "
                    "error is no assumption: leave one of the two out"
                )


def shared_covariance(
    uncertainties: Mapping[str, float],
    problem: Problem,
    z: Float[np.ndarray, " p"],
    rows: Float[np.ndarray, "p r"],
) -> Float[np.ndarray, "p p"]:
    """Covariance of the gradient J^T r by shared errors; `rows` are those of J^T."""
    covariance = np.zeros((len(rows), len(rows)))
    for name, sd in uncertainties.items():
        change = (
            _gain_change(problem) if name == "gain" else _emissivity_change(problem, z)
        )
        gradient = rows[:, : len(change)] @ change[: rows.shape[1]]
        covariance += sd**2 * np.outer(gradient, gradient)
    return covariance


def _gain_change(problem: Problem) -> Float[np.ndarray, " r"]:
    """Change of the data's residuals for a relative change of all radiances."""
    changes = []
    for case, weight in zip(problem.cases, problem.case_weights, strict=True):
        target = case.target
        assert isinstance(target, FrameTarget)
        per_time = []
        for pixels in target.data:
            value = jnp.asarray(pixels)
            if target.frame_quantity.quantity == "temperature":
                value = _kelvin_per_radiance(value, target.frame_quantity.band)
            per_time.append(np.asarray(value, float))
        change = np.concatenate(per_time, axis=1).reshape(-1)
        changes.append(weight * change / (target.noise * np.sqrt(target.pixel_count)))
    return np.concatenate(changes)


def _kelvin_per_radiance(
    kelvin: Float[Array, "t p"], band: Band | None
) -> Float[Array, "t p"]:
    """Change of a temperature for a relative change of its radiance, L / (dL/dT)."""

    def radiance(kelvin: Float[Array, " n"]) -> Any:
        return black_radiance(kelvin, band)

    flat = kelvin.reshape(-1)
    value, slope = jax.jvp(radiance, (flat,), (jnp.ones_like(flat),))
    return (value / slope).reshape(kelvin.shape)


def _emissivity_change(
    problem: Problem, z: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " r"]:
    """Change of all residuals for a relative change of all emissivities."""

    def residuals(factor: Float[Array, " 1"], arguments: Any) -> Any:
        cases = tuple(
            replace(case, scene=_with_emissivities(case.scene, 1 + factor[0]))
            for case in problem.cases
        )
        z, step_tables, views = arguments
        rows, _ = replace(problem, cases=cases).residuals(z, step_tables, views)
        # The integer takes the place of the diagnostics, and has no tangent.
        return rows, jnp.zeros((), jnp.int32)

    with precision(problem.dtype.name):
        coordinates = jnp.asarray(z, problem.dtype)
        step_tables = problem.step_tables_at(coordinates)
        factor = jnp.zeros(1, problem.dtype)
        arguments = (coordinates, step_tables, problem.views_at(coordinates))
        traced = trace(residuals, factor, arguments)
        rows = jacobian_rows(traced, args=arguments, z=factor, batch=1)
    return np.asarray(rows[0], float)


def _surface_materials(body: Body, number: int) -> list[Path]:
    """Paths of the materials at the surface of the body with this number."""
    if not isinstance(body.structure, Sheet):
        return [("bodies", number, "material")]
    paths: set[Path] = set()
    for part, stack in enumerate(body.structure.stacks):
        for layer in (0, len(stack) - 1):
            paths.add(
                ("bodies", number, "structure", "stacks", part, layer, "material")
            )
    return sorted(paths)


def _with_emissivities(scene: Scene, factor: Float[Array, ""]) -> Scene:
    values: dict[Path, Any] = {}
    for number, body in enumerate(scene.bodies):
        paths = [(*path, "emissivity") for path in _surface_materials(body, number)]
        paths += [
            ("bodies", number, "coatings", n, "emissivity")
            for n in range(len(body.coatings))
        ]
        for path in paths:
            value = value_at(scene, path)
            if value is not None:
                values[path] = jnp.asarray(value, factor.dtype) * factor
    return with_values(scene, values)

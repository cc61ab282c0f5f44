"""What is simulated: bodies in space, and a tuple of terms."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..errors import InputError
from ..materials import Material
from ..physics.term import AbstractTerm
from ..structures.structure import AbstractStructure
from ..structures.surface_map import AbstractSurfaceMap, FluxCorrectedMap
from ..tracing import is_traced
from ..voxels.select import Region


class Pose(eqx.Module):
    """A rigid placement: x -> rotation x + translation."""

    translation: tuple[float, float, float] = eqx.field(
        static=True, default=(0.0, 0.0, 0.0)
    )
    """[m]"""
    rotation: tuple[tuple[float, float, float], ...] = eqx.field(
        static=True, default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )
    """Rows of a rotation matrix."""

    def __check_init__(self):
        matrix = np.asarray(self.rotation, float)
        if matrix.shape != (3, 3) or not (
            np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)
            and np.linalg.det(matrix) > 0
        ):
            raise InputError(
                f"Pose(rotation={self.rotation!r}): give a 3 x 3 rotation matrix"
            )

    def place(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the body in the world [m]."""
        return self.turn(points) + np.asarray(self.translation, float)

    def turn(self, vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Directions of the body in the world."""
        return vectors @ np.asarray(self.rotation, float).T

    def unplace(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """World points in the body's frame [m]."""
        return self.unturn(points - np.asarray(self.translation, float))

    def unturn(self, vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """World directions in the body's frame."""
        return vectors @ np.asarray(self.rotation, float)


class MaterialMap(eqx.Module):
    """A base material, with others painted over it in boxes, later ones on top."""

    base: Material
    painted: tuple[tuple[Region, Material], ...] = ()

    def number(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Which material each point has: 0 for the base, i for the i-th painted one."""
        number = np.zeros(len(points), np.int32)
        for i, (region, _) in enumerate(self.painted):
            number[region.contains(points)] = i + 1
        return number

    def table(self, field: str, dtype: Any) -> Float[Array, " c"]:
        """One property of every material, in the order of their numbers."""
        materials = (self.base, *(material for _, material in self.painted))
        return jnp.stack([jnp.asarray(getattr(m, field), dtype) for m in materials])


class Body(eqx.Module):
    """A structure of some material at some temperature, somewhere."""

    structure: AbstractStructure
    material: Material | MaterialMap
    temperature: Any = eqx.field(kw_only=True)
    """At the start [K]: a number, or a function of positions [n 3] (own frame, m)."""
    pose: Pose = eqx.field(kw_only=True, default=Pose())
    surface_map: AbstractSurfaceMap = eqx.field(
        kw_only=True, default=FluxCorrectedMap()
    )
    """How the surface's temperature is read from the nodes."""

    def __check_init__(self):
        if callable(self.temperature) or is_traced(self.temperature):
            return
        try:
            kelvin = float(self.temperature)
        except (TypeError, ValueError):
            kelvin = np.nan
        if not np.isfinite(kelvin) or kelvin < 0:
            raise InputError(
                f"Body(temperature={self.temperature!r}): give kelvin, as a "
                "number or a function of positions"
            )


class Scene(eqx.Module):
    """Bodies and what acts on them; what is not in `terms` is not computed."""

    bodies: tuple[Body, ...]
    terms: tuple[AbstractTerm, ...] = ()
    dtype: str = eqx.field(static=True, default="float32")
    """Of the state: "float32", or "float64" for twice the memory and all the digits."""

    def __check_init__(self):
        if not self.bodies:
            raise InputError("Scene(bodies=()): give at least one body")
        if self.dtype not in ("float32", "float64"):
            raise InputError(
                f"Scene(dtype={self.dtype!r}): choose 'float32' or 'float64'"
            )
        if sum(term.name == "emission" for term in self.terms) > 1:
            raise InputError(
                "Scene: two Surroundings would count the emission twice; give one, "
                "whose temperature may be a function of time"
            )
        for i, term in enumerate(self.terms):
            on = getattr(term, "on", None)
            if on is not None and not 0 <= on.body < len(self.bodies):
                raise InputError(
                    f"terms[{i}] is on body {on.body}, and there are "
                    f"{len(self.bodies)}: count from 0"
                )

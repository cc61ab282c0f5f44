"""Solid body in a lattice: a cylinder with its true surface, or a mask of cells.

A link joins a cell of fluid to one of the body; q is the fraction of its length at
which it meets the surface. What a population that leaves the fluid cell x_f along the
link brings back is interpolated (Bouzidi, Firdaouss and Lallemand 2001),

    f_i(x_f) = 2 q f_o(x_f) + (1 - 2 q) f_o(x_f + c_i)            for q < 1/2,
    f_i(x_f) = f_o(x_f) / (2 q) + (1 - 1 / (2 q)) f_i(x_f)        otherwise,

from populations after the collision, o opposite to i. It is written into the cell of
the body at x_f - c_i, from which the fluid then draws it as from any other cell. A
temperature of the surface reverses the sign and adds 2 w_i T, times 1 / (2 q) in the
second case.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jax import lax
from jaxtyping import Array, Bool, Float

from ..arrays import Scalar
from .lattice import OPPOSITE, VELOCITIES, WEIGHTS, Populations, written


class RoundBody(NamedTuple):
    """Cylinder across the plane of a flow."""

    centre: tuple[float, float]
    """Position (x, y) from the corner between inlet and lower wall [cells]."""
    diameter: float
    """[cells]"""

    def mask(self, shape: tuple[int, int]) -> Bool[np.ndarray, "y x"]:
        """Return the cells of a (height, length) domain whose middle is inside."""
        x, y = _middles(shape)
        distance = np.hypot(x - self.centre[0], y - self.centre[1])
        return distance < self.diameter / 2


class SolidCells(NamedTuple):
    """Body of whole cells; hashable, since equal masks are equal."""

    shape: tuple[int, ...]
    packed: bytes

    def mask(self, shape: tuple[int, int]) -> Bool[np.ndarray, "y x"]:
        """Return the solid cells of a domain of the same shape."""
        bits = np.unpackbits(np.frombuffer(self.packed, np.uint8))
        return bits[: math.prod(shape)].astype(bool).reshape(shape)


def solid_cells(mask: Bool[np.ndarray, "..."]) -> SolidCells:
    """Body of the cells where a mask is true."""
    return SolidCells(mask.shape, np.packbits(mask).tobytes())


class Links(Module):
    """Links of a body, in the box of cells that holds it.

    Factors of the populations that a cell of the body gives back to the fluid, one row
    for each velocity but 0; all are 0 where there is no link.
    """

    corner: tuple[int, int] = eqx.field(static=True)
    """Row and column of the box in arrays with a frame."""
    solid: Bool[np.ndarray | Array, "y x"]
    fraction: Float[np.ndarray | Array, "8 y x"]
    """q, from the fluid; 0 without a link."""
    near: Float[np.ndarray | Array, "8 y x"]
    """Factor of the population that left the fluid cell."""
    far: Float[np.ndarray | Array, "8 y x"]
    """Factor of the population that left the fluid cell behind that."""
    same: Float[np.ndarray | Array, "8 y x"]
    """Factor of the population that already moves away from the body."""
    wall: Float[np.ndarray | Array, "8 y x"]
    """2 w_i, times 1 / (2 q) from q = 1/2 on: factor of the surface's temperature."""


Body = RoundBody | SolidCells


def _middles(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.indices(shape) + 0.5
    return x, y


def body_links(body: Body, shape: tuple[int, int]) -> Links:
    """Links of a body in a domain of (height, length) cells."""
    mask = body.mask(shape)
    rows = np.flatnonzero(mask.any(1))
    columns = np.flatnonzero(mask.any(0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    solid = mask[box]
    x, y = (values[box] for values in _middles(shape))
    factors = np.zeros((5, 8, *solid.shape))
    for i in range(1, 9):
        cx, cy = VELOCITIES[i]
        to_fluid = np.roll(mask, (-cy, -cx), (0, 1))[box]
        link = solid & ~to_fluid
        q = np.full(solid.shape, 0.5)
        if isinstance(body, RoundBody):
            q[link] = _fraction(body, x=x[link] + cx, y=y[link] + cy, cx=-cx, cy=-cy)
        close = q < 0.5
        near = np.where(close, 2 * q, 1 / (2 * q))
        far = np.where(close, 1 - 2 * q, 0.0)
        same = np.where(close, 0.0, 1 - 1 / (2 * q))
        wall = 2 * WEIGHTS[i] * np.where(close, 1.0, 1 / (2 * q))
        factors_of_link = np.stack([q, near, far, same, wall])
        factors[:, i - 1] = np.where(link, factors_of_link, 0.0)
    fraction, near, far, same, wall = factors
    return Links(
        corner=(int(rows[0]) + 1, int(columns[0]) + 1),
        solid=solid,
        fraction=fraction,
        near=near,
        far=far,
        same=same,
        wall=wall,
    )


def _fraction(body: RoundBody, x, y, cx: int, cy: int) -> Float[np.ndarray, " n"]:
    """Fraction of a link from fluid cells at which it meets the cylinder."""
    dx = x - body.centre[0]
    dy = y - body.centre[1]
    square = cx * cx + cy * cy
    half = (dx * cx + dy * cy) / square
    offset = (dx * dx + dy * dy - body.diameter**2 / 4) / square
    # A cell on the surface itself would give 0 and divide by nothing further on.
    return np.clip(-half - np.sqrt(half * half - offset), 1e-6, 1.0)


def _part(a: Float[Array, "_ _"], links: Links, x: int, y: int) -> Float[Array, "h w"]:
    # The cells of the box, moved by (x, y).
    row, column = links.corner
    height, width = links.solid.shape
    return lax.slice(a, (row + y, column + x), (row + y + height, column + x + width))


def reflected(
    f: Populations, links: Links, temperature: Scalar | None = None
) -> Populations:
    """Populations that the cells of a body's box give back; 0 without a link."""
    dtype = f[0].dtype
    out = [jnp.zeros(links.solid.shape, dtype)]
    for i in range(1, 9):
        x, y = VELOCITIES[i]
        opposite = f[OPPOSITE[i]]
        near = links.near[i - 1].astype(dtype)
        back = near * _part(opposite, links=links, x=x, y=y)
        far = links.far[i - 1].astype(dtype)
        back += far * _part(opposite, links=links, x=2 * x, y=2 * y)
        same = links.same[i - 1].astype(dtype) * _part(f[i], links=links, x=x, y=y)
        if temperature is None:
            out.append(back + same)
        else:
            wall = links.wall[i - 1].astype(dtype)
            out.append(same - back + wall * temperature)
    return tuple(out)


def filled(
    f: Populations, links: Links, reflected_populations: Populations
) -> Populations:
    """Populations with those that the body's cells give back."""
    changes = {}
    for i, (population, new) in enumerate(zip(f, reflected_populations, strict=True)):
        inside = _part(population, links=links, x=0, y=0)
        changes[i] = (links.corner, jnp.where(links.solid, new, inside))
    return written(f, changes)[0]


def force_on(
    f: Populations, links: Links, reflected_populations: Populations
) -> Float[Array, "2"]:
    """Force on the body (drag, lift): momentum exchanged over all links in a step.

    In lattice units of density times cells^3 per step^2, per cell of depth.
    """
    total = [jnp.zeros((), f[0].dtype)] * 2
    for i in range(1, 9):
        x, y = VELOCITIES[i]
        link = links.near[i - 1] > 0
        leaving = _part(f[OPPOSITE[i]], links=links, x=x, y=y)
        passed = jnp.where(link, leaving + reflected_populations[i], 0.0).sum()
        total = [total[0] - x * passed, total[1] - y * passed]
    return jnp.stack(total)


def heat_of(g: Populations, links: Links) -> Float[Array, "8 y x"]:
    """Heat that leaves a body of temperature 1 over each link in a step."""
    back = reflected(g, links, 1.0)
    rows = []
    for i in range(1, 9):
        x, y = VELOCITIES[i]
        leaving = back[i] - _part(g[OPPOSITE[i]], links=links, x=x, y=y)
        rows.append(jnp.where(links.near[i - 1] > 0, leaving, 0.0))
    return jnp.stack(rows)


def link_angles(body: RoundBody, links: Links) -> Float[np.ndarray, "8 y x"]:
    """Angle from the front [rad] at which each link meets a cylinder."""
    row, column = np.indices(links.solid.shape)
    angles = np.zeros(links.fraction.shape)
    for i in range(1, 9):
        # From the cell of the body towards the fluid, in arrays without a frame.
        past = 1 - links.fraction[i - 1]
        x = column + links.corner[1] - 0.5 + past * VELOCITIES[i][0]
        y = row + links.corner[0] - 0.5 + past * VELOCITIES[i][1]
        angles[i - 1] = np.abs(np.arctan2(y - body.centre[1], body.centre[0] - x))
    return angles

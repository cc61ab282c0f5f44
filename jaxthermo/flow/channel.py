"""Description of a flow in a plane: domain, inlet, walls, body; and its checks."""

from typing import Any

import equinox as eqx
import numpy as np
from equinox import Module
from jaxtyping import Float

from ..arrays import Scalar, is_traced
from ..choices import ChannelEnds, ChannelWalls, Inlet
from ..errors import InputError
from .body import Links, RoundBody, SolidCells, body_links, solid_cells
from .lattice import MAGIC, SOUND


_INLETS = ("plug", "poiseuille")
_WALLS = ("no_slip", "slip", "periodic")
_ENDS = ("open", "periodic")

MAX_MACH = 0.15
"""Largest Mach number: errors of compressibility grow with its square."""
_MAX_CELL_REYNOLDS = 12.0
"""Largest Reynolds number of one cell, beyond which runs became unstable (at 17)."""
_MAX_VISCOSITY = 1.0

# Cells of fluid between a body and whatever is next to it: the interpolation at its
# surface reads two.
_GAP = 2


def _plain_body(body: Any) -> Any:
    # Static fields must be hashable.
    is_mask = isinstance(body, np.ndarray) and body.dtype == bool
    return solid_cells(body) if is_mask else body


class Channel(Module):
    """Flow through a channel along x, around a body, in lattice units.

    The inlet is at x = 0 and the outlet at x = length; walls lie along y = 0 and
    y = height. Lengths are in cells, times in steps. The flow starts as that of the
    inlet everywhere.

    Raises:
        InputError: for a speed or viscosity outside of the stable range, and for a body
            that blocks the channel or touches a wall, the inlet or the outlet.
    """

    shape: tuple[int, int] = eqx.field(static=True)
    """Height and length [cells]."""
    speed: Scalar
    """Mean speed of the inlet [cells per step]; at most 0.087 / 1.5 with a parabola."""
    viscosity: Scalar
    """Kinematic viscosity [cells^2 per step]."""
    body: Any = eqx.field(static=True, default=None, converter=_plain_body)
    """A `RoundBody`, or a mask of solid cells of the domain's shape; None without."""
    inlet: Inlet = eqx.field(static=True, default="plug")
    """Speed across the inlet: even ("plug"), or a long channel's ("poiseuille")."""
    walls: ChannelWalls = eqx.field(static=True, default="slip")
    """"no_slip", "slip" or "periodic"."""
    ends: ChannelEnds = eqx.field(static=True, default="open")
    """"open", or "periodic" without an inlet, where a force drives the flow."""
    force: tuple[Scalar, Scalar] | None = None
    """Force on the fluid along x and y [cells per step^2, at density 1]."""
    diffusivity: Scalar | None = None
    """Thermal diffusivity [cells^2 per step]; None without temperatures."""
    magic: float = eqx.field(static=True, default=MAGIC)
    """Product of the relaxation times; see `lattice`."""

    def __check_init__(self):
        _check_words(self)
        _check_numbers(self)
        if self.body is not None:
            _check_body(self)

    @property
    def links(self) -> Links | None:
        """Links of the body."""
        return None if self.body is None else body_links(self.body, self.shape)

    @property
    def profile(self) -> Float[np.ndarray, " n"]:
        """Speed of the inlet over its mean, in every row of cells."""
        at = (np.arange(self.shape[0]) + 0.5) / self.shape[0]
        parabola = at * (1 - at)
        even = np.ones_like(at)
        return parabola / parabola.mean() if self.inlet == "poiseuille" else even


def _check_words(channel: Channel) -> None:
    options_by_name = {"inlet": _INLETS, "walls": _WALLS, "ends": _ENDS}
    for name, words in options_by_name.items():
        value = getattr(channel, name)
        if value not in words:
            raise InputError(f"Channel({name}={value!r}): give {' or '.join(words)}")
    height, length = channel.shape
    if min(height, length) < 4:
        raise InputError(f"Channel(shape={channel.shape}): give at least 4 x 4 cells")


def _check_numbers(channel: Channel) -> None:
    if is_traced((channel.speed, channel.viscosity, channel.diffusivity)):
        return
    speed = float(channel.speed)
    viscosity = float(channel.viscosity)
    if not 0 < viscosity <= _MAX_VISCOSITY:
        raise InputError(
            f"Channel(viscosity={viscosity:g}): give a number above 0 and up to "
            f"{_MAX_VISCOSITY:g} cells^2 per step"
        )
    diffusivity = channel.diffusivity
    if diffusivity is not None and not 0 < float(diffusivity) <= _MAX_VISCOSITY:
        raise InputError(
            f"Channel(diffusivity={float(diffusivity):g}): give a number above 0 and "
            f"up to {_MAX_VISCOSITY:g} cells^2 per step"
        )
    highest = speed * float(channel.profile.max())
    if not 0 <= highest < MAX_MACH * SOUND:
        raise InputError(
            f"Channel(speed={speed:g}): the Mach number {highest / SOUND:.3g} is not "
            f"between 0 and {MAX_MACH:g}: give a speed below "
            f"{MAX_MACH * SOUND * speed / max(highest, 1e-300):.3g} cells per step"
            if highest
            else f"Channel(speed={speed:g}): give a finite speed of at least 0"
        )
    if highest / viscosity > _MAX_CELL_REYNOLDS:
        raise InputError(
            f"Channel(viscosity={viscosity:g}): the Reynolds number of a cell is "
            f"{highest / viscosity:.3g}, above {_MAX_CELL_REYNOLDS:g}: use more cells "
            "across the body, or a higher viscosity"
        )


def _check_body(channel: Channel) -> None:
    body = channel.body
    height, length = channel.shape
    where = "Channel(body=)"
    if isinstance(body, RoundBody):
        x, y = body.centre
        radius = body.diameter / 2
        if not (np.isfinite([x, y, radius]).all() and radius > 0):
            raise InputError(f"{where}: {body} is no cylinder: give finite numbers")
        ends = [y - radius, height - y - radius, x - radius, length - x - radius]
        blocks = 2 * radius >= height - 2 * _GAP
        solid = body.mask(channel.shape)
    else:
        if not isinstance(body, SolidCells) or body.shape != channel.shape:
            raise InputError(
                f"{where}: give a RoundBody, or true and false of shape {channel.shape}"
            )
        solid = body.mask(channel.shape)
        if not solid.any():
            raise InputError(f"{where}: no cell is solid: give a mask of the body")
        rows = np.flatnonzero(solid.any(1))
        columns = np.flatnonzero(solid.any(0))
        ends = [rows[0], height - 1 - rows[-1], columns[0], length - 1 - columns[-1]]
        blocks = bool(solid.all(axis=0).any())
    if blocks:
        raise InputError(f"{where}: it blocks the channel: use a higher channel")
    names = ("the lower wall", "the upper wall", "the inlet", "the outlet")
    for gap, name in zip(ends, names, strict=True):
        if gap < _GAP:
            raise InputError(
                f"{where}: it touches {name}: leave at least {_GAP} cells of fluid"
            )
    if not solid.any():
        raise InputError(f"{where}: it is smaller than a cell: use a larger diameter")

"""Coatings: radiative properties of a part of a body's surface."""

from typing import Any

import numpy as np
from equinox import Module
from jaxtyping import Float

from ..arrays import Numbers, is_traced, namespace
from ..errors import InputError
from ..material.table import emissivity_row
from ..physics.flux_law import Values
from ..voxels.abstract_grid import AbstractGrid
from ..voxels.selection import AbstractSelection


class Coating(Module):
    """Emissivity and absorptivity of a part of a body that replace its material's.

    A coating changes the radiative properties alone: it has no thickness. Later ones of
    a body are on top.

    Example:
        >>> import jaxthermo as jt
        >>> tape = jt.Coating(0.95, on=jt.Side((0.0, 0.0, 1.0)))
        >>> white = jt.Coating(0.9, absorptivity=0.2)
        >>> jt.Coating.of_finish("car paint, black").absorptivity
        0.95
    """

    emissivity: Numbers | None
    """eps [-]; None for the material's."""
    given_absorptivity: Numbers | None
    on: AbstractSelection | None

    def __init__(
        self,
        emissivity: Numbers | None = None,
        absorptivity: Numbers | None = None,
        on: AbstractSelection | None = None,
    ):
        """Define a coating by numbers from 0 to 1, or by one for each fragment.

        Args:
            emissivity: eps in the long-wave infrared [-], one number or one for each
                fragment of the body; the material's if not given.
            absorptivity: for radiation sources such as the sun [-], likewise; by
                default the emissivity of the coating.
            on: part of the surface; all of it if not given. The number of the body in
                it is not used.

        Raises:
            InputError: for a value out of range, or without any value.
        """
        if emissivity is None and absorptivity is None:
            raise InputError("Coating(): give an emissivity, an absorptivity, or both")
        self.emissivity = _fractions("emissivity", emissivity)
        self.given_absorptivity = _fractions("absorptivity", absorptivity)
        self.on = on

    @classmethod
    def of_finish(cls, surface: str, on: AbstractSelection | None = None) -> "Coating":
        """Coating with the emissivity and absorptivity of a tabulated finish.

        Args:
            surface: name of the finish; `jaxthermo materials --emissivity` lists them.
            on: part of the surface; all of it if not given.

        Raises:
            InputError: for an unknown name, with similar names.
        """
        row = emissivity_row(surface)
        return cls(row.emissivity, absorptivity=row.absorptivity, on=on)

    @property
    def absorptivity(self) -> Numbers | None:
        """Fraction of a source's radiation that is absorbed [-]."""
        if self.given_absorptivity is None:
            return self.emissivity
        return self.given_absorptivity

    def over(
        self, below: Float[Values, "*_"], field: str, grid: AbstractGrid
    ) -> Float[Values, "*s"]:
        """A property of the coating where it is, and of the surface below elsewhere.

        Raises:
            InputError: if it selects no surface, or has values for another number of
                fragments.
        """
        values: Any = getattr(self, field)
        if values is None:
            return below
        count = len(grid.fragment_area)
        if np.ndim(values) and np.shape(values) != (count,):
            raise InputError(
                f"Coating({field}=): {np.shape(values)[0]} values for a body of "
                f"{count} fragments: give one number, or one for each fragment"
            )
        xp = namespace((values, below))
        if self.on is None:
            return xp.asarray(values, below.dtype)
        where = self.on.select(grid.fragment_centres)
        if not where.any():
            raise InputError(
                f"Coating(on={self.on!r}) selects no surface of its body: check its "
                "corners or its normal, which are in the body's own frame, in metres"
            )
        return xp.where(where, xp.asarray(values, below.dtype), below)


def _fractions(name: str, number: Any) -> Any:
    if number is None or is_traced(number):
        return number
    try:
        values = np.asarray(number, float)
    except (TypeError, ValueError):
        values = np.full(1, np.nan)
    if values.ndim > 1 or not ((values >= 0) & (values <= 1)).all():
        raise InputError(
            f"Coating({name}=): give a number from 0 to 1, or a list with one for each "
            "fragment"
        )
    return values if values.ndim else float(values)

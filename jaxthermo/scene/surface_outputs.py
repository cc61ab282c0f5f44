"""Outputs that a solution can have for every fragment, besides its temperature."""

from collections.abc import Iterable

from ..choices import SurfaceOutput
from ..errors import InputError


SURFACE_OUTPUTS: tuple[SurfaceOutput, ...] = ("heat_flux", "heat_transfer_coefficient")
"""Names of all of them."""


def as_surface_outputs(names: Iterable[SurfaceOutput]) -> tuple[SurfaceOutput, ...]:
    """Outputs by their names.

    Raises:
        InputError: for a name that is none of `SURFACE_OUTPUTS`.
    """
    outputs = tuple(names)
    for name in outputs:
        if name not in SURFACE_OUTPUTS:
            raise InputError(
                f"Scene(surface_outputs=): {name!r} is none; name some of "
                f"{', '.join(SURFACE_OUTPUTS)}"
            )
    return outputs

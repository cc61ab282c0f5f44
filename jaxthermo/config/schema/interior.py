"""Air inside a closed body."""

from typing import Any, ClassVar

from typing_extensions import override

import jaxthermo

from ...errors import located
from ..types import quantities as si
from ..types.model import Model, build
from ..types.varying import Varying


class AirConfig(Model, builds="AirVolume"):
    """A volume of air whose temperature follows from what it touches."""

    volume: si.PositiveVolume | None = None
    """Volume [m^3]; that of the closed cavities of the body if not given."""
    exchange: Varying[si.AirExchange] = 0.0
    """Volume of outer air that enters per time over the volume [1/s]."""
    outside: Varying[si.Temperature] | None = None
    """Temperature of the air that enters [K]; that of `outdoors` if not given."""
    temperature: si.Temperature | None = None
    """Temperature at the start [K]; that of the body if not given."""

    @property
    def is_exchanged(self) -> bool:
        """True if outer air enters."""
        return self.exchange != 0.0


class InteriorConfig(Model, builds="InteriorAir"):
    """Air in the closed cavities of a body, of a given temperature or its own."""

    temperature: Varying[si.Temperature] | None = None
    """Temperature of the air [K], if it is given."""
    air: AirConfig | None = None
    """Volume of the air, if its temperature is to be computed."""
    heat_transfer_coefficient: Varying[si.HeatTransferCoefficient]
    """To all that faces the air: inner faces, and bodies within."""

    exactly_one: ClassVar = (("temperature", "air"),)

    def build_air(self, body: Any, number: int) -> Any:
        """The body of air in a built body with this number.

        Raises:
            InputError: if the body has no cavity.
        """
        assert self.air is not None
        volume = self.air.volume
        if volume is None:
            with located(f"bodies.{number}.interior.air"):
                volume = jaxthermo.AirVolume.inside(body.structure)
        else:
            volume = jaxthermo.AirVolume(volume)
        start = self.air.temperature
        return jaxthermo.Body(
            volume, temperature=body.temperature if start is None else start
        )

    @override
    def build(self, *args: Any) -> Any:
        """The air as a term.

        The arguments are the numbers of the body and of its air, and the temperature
        of the air outdoors; None for none.
        """
        body, air, outdoors = args
        h = build(self.heat_transfer_coefficient)
        if self.air is None:
            return jaxthermo.InteriorAir(h, build(self.temperature), body=body)
        outside = self.air.outside
        return jaxthermo.EnclosedAir(
            h,
            exchange=build(self.air.exchange),
            temperature=outdoors if outside is None else build(outside),
            body=body,
            air=air,
        )

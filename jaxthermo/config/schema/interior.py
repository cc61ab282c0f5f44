"""Air inside a closed body."""

from typing import Any

from typing_extensions import override

from ..types import quantities as si
from ..types.model import Model
from ..types.varying import Varying


class InteriorConfig(Model, builds="InteriorAir"):
    """Air of a given temperature in the closed cavities of a body."""

    temperature: Varying[si.Temperature]
    heat_transfer_coefficient: Varying[si.HeatTransferCoefficient]
    """To all that faces the air: inner faces, and bodies within."""

    @override
    def build(self, *args: Any) -> Any:
        """The air as a term, from the number of the body."""
        (body,) = args
        return self.target()(**self.arguments(), body=body)

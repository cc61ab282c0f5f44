"""Values that an argument may have, as editors and type checkers show them.

At run time the functions and classes refuse a wrong value themselves, with a remedy.
"""

from typing import TYPE_CHECKING, Literal


if TYPE_CHECKING:
    UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
    Inside = Literal["closed", "open"]
    FaceName = Literal["front", "back"]
    Kernels = Literal["numba"] | None
    Hollow = Literal["empty", "innermost"]
    ShellCapacity = Literal["body", "own"]
    Inlet = Literal["plug", "poiseuille"]
    ChannelWalls = Literal["no_slip", "slip", "periodic"]
    ChannelEnds = Literal["open", "periodic"]
    ReductionMethod = Literal["krylov", "pod"]
    Quantity = Literal["apparent", "surface"]
else:
    UpAxis = Inside = FaceName = Hollow = ShellCapacity = str
    Inlet = ChannelWalls = ChannelEnds = ReductionMethod = Quantity = str
    Kernels = str | None

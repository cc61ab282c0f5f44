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
    Dtype = Literal["float32", "float64"]
    SurfaceOutput = Literal["heat_flux", "heat_transfer_coefficient"]
    CylinderAverage = Literal["churchill_bernstein", "sanitjai_goldstein", "profile"]
    OutdoorTerm = Literal["sun", "diffuse", "sky", "wind", "convection"]
    Palette = Literal[
        "iron", "ember", "white-hot", "black-hot", "rainbow", "arctic", "lava"
    ]
else:
    UpAxis = Inside = FaceName = Hollow = ShellCapacity = str
    Inlet = ChannelWalls = ChannelEnds = ReductionMethod = Quantity = str
    Dtype = SurfaceOutput = CylinderAverage = OutdoorTerm = Palette = str
    Kernels = str | None

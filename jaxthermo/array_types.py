"""Names for shapes and scalars, shared by every annotation.

Shape letters: n nodes, e links, s surface fragments, x y z voxels, v vertices,
f faces, k raster fragments, l levels, t saved times, b bodies, h w pixels, p points.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Array, Bool, Float, Int


Vec3 = tuple[float, float, float] | Float[np.ndarray, "3"]
"""A point or a direction given by the user [m or -]."""

Scalar = float | int | Float[Array, ""] | Float[np.ndarray, ""] | np.floating
"""One number, traced or not."""

TimeValue = Scalar | Callable
"""A number, or a function of time [s] that gives one."""

HostFloat = Float[np.ndarray, "..."]
HostInt = Int[np.ndarray, "..."]
HostBool = Bool[np.ndarray, "..."]

"""Sparse matrices of the links of a structure."""

import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_array, csr_array, diags_array

from jaxthermo.structures.structure import Links


def laplacian(
    links: Links, conductance: Float[np.ndarray, " e"], count: int
) -> csr_array:
    """Matrix of the heat that each of `count` nodes loses per kelvin of every node.

    Its unit is that of the conductance of the links.
    """
    half = coo_array((conductance, (links.src, links.dst)), (count, count)).tocsr()
    between = half + half.T
    return csr_array(diags_array(between.sum(axis=1)) - between)

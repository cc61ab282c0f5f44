"""Memory that a scene will take, known before it is taken."""

import numpy as np

from ...memory import require_memory
from ..scene import AbstractMaterials, Scene


def check_memory(scene: Scene, saves: int, snapshots: int) -> int:
    """Forecast of the solver's peak memory [bytes], refused if there is not enough.

    Args:
        scene: bodies and terms.
        saves: how many times will be kept.
        snapshots: how many times the scene is taken anew.

    Raises:
        InputError: if it would not fit.
    """
    width = 8 if scene.dtype == "float64" else 4
    total = 0
    for body in scene.bodies:
        structure = body.structure
        cells = int(np.prod(structure.state_shape))
        fragments = len(structure.grid.fragment_area)
        copies = 4 if not isinstance(body.material, AbstractMaterials) else 12
        # Saved rows are held twice while the solution is put together.
        each = 40 * snapshots + 2 * saves
        total += cells * (copies * width + 1) + fragments * each * width
        if len(structure.state_shape) == 1:
            # A link stands in two rows, with the neighbour's number and conductance.
            total += structure.link_count * (5 * width + 24)
    remedy = "use a coarser pitch, or save fewer times"
    require_memory(total, "simulating this scene", remedy)
    return total

"""A scene whose full volumes are spread over several devices.

Lattices, surface cells and the nodes that loads act on have a section on each device,
see `ShardedLattice`. The rest of a scene, including what reads the temperatures of
fragments, is on every device.
"""

from dataclasses import replace

from ...errors import InputError
from ...memo.found import found
from ...parallel.devices import check_devices
from ...parallel.lattice import placed
from ...structures.kinds.full import FullVolume
from ...voxels.sharded_lattice import sharded_lattice
from ..scene import Body, Scene
from .memory import has_varying_links
from .program import Program


def on_devices(scene: Scene, devices: int) -> Scene:
    """Return the scene with its bodies on a number of devices; itself for 1.

    Raises:
        InputError: if there are fewer devices, or a body cannot be spread over them.
    """
    check_devices(devices)
    if devices == 1:
        return scene
    if scene.is_traced:
        raise InputError(
            f"devices={devices}: values of the scene are traced; derivatives, jit and "
            "vmap need one device: leave devices out"
        )

    def spread() -> Scene:
        bodies = tuple(
            _on_devices(body, f"bodies[{n}]", devices)
            for n, body in enumerate(scene.bodies)
        )
        return replace(scene, bodies=bodies)

    return found((scene,), ("on devices", devices), spread)


def _on_devices(body: Body, where: str, devices: int) -> Body:
    structure = body.structure
    if not isinstance(structure, FullVolume):
        name = type(structure).__name__
        raise InputError(
            f"{where}: {name} cannot be spread over devices={devices}; a FullVolume "
            "can, or leave devices out: it is small enough for one"
        )
    if not structure.runs_as_stencil:
        raise InputError(
            f"{where}: a FullVolume with weights, stencil=False or kernels of numba "
            f"cannot be spread over devices={devices}; leave these out, or devices"
        )
    if has_varying_links(body.material):
        raise InputError(
            f"{where}: several materials, or one by axis, that vary with temperature "
            f"run as links and cannot be spread over devices={devices}; leave it out"
        )
    # Refuses a body that is too short.
    sharded_lattice(structure.grid.solid, devices)
    return replace(body, structure=replace(structure, devices=devices))


def placed_on_devices(tree, scene: Scene, program: Program):
    """Return arrays of a compiled scene, or of its stepper, on its devices."""
    mesh = program.mesh
    if mesh is None:
        return tree
    shapes = {body.structure.state_shape for body in scene.bodies}
    if program.surface is not None:
        for cells in program.surface.by_cell.cells:
            shapes |= {cells.node.shape, cells.address[0].shape}
    for body in program.bodies:
        shapes |= {source.rise.shape for source in body.sources}
    return placed(mesh, tree, frozenset(shapes))

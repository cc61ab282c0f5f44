"""Heat transfer in triangle meshes as a thermal camera sees it, differentiable, in JAX.

Names are resolved when first used, in the order of the data flow, so that importing the
package costs nothing of what is not used.
"""

import importlib
from importlib.metadata import version as _version
from typing import Any


_HOME = {
    "InputError": "errors",
    "Mesh": "geometry.mesh",
    "load_mesh": "geometry.load",
    "voxelize": "voxels.voxelize",
    "VoxelGrid": "voxels.grid",
    "Side": "voxels.selection",
    "Region": "voxels.selection",
    "Everything": "voxels.selection",
    "FragmentMask": "voxels.selection",
    "Cylinder": "voxels.cylinders",
    "ConductionWeights": "structures.structure",
    "FitCard": "structures.structure",
    "load_card": "config.card_file",
    "FullVolume": "structures.kinds.full",
    "SingleShell": "structures.kinds.shell",
    "MultiLevel": "structures.kinds.groups",
    "IrregularMultiLevel": "structures.kinds.shell",
    "Octree": "structures.kinds.groups",
    "Aggregate": "structures.kinds.aggregate",
    "ShellOverCore": "structures.kinds.groups",
    "Partition": "structures.kinds.groups",
    "ConstantMap": "structures.surface_map",
    "LinearMap": "structures.surface_map",
    "FluxCorrectedMap": "structures.surface_map",
    "Material": "material.material",
    "materials": "material.table",
    "Property": "material.material",
    "Table": "physics.time_varying",
    "Until": "physics.time_varying",
    "PointTable": "physics.radiation.source",
    "DirectionTable": "physics.radiation.source",
    "AbstractFluxLaw": "physics.flux_law",
    "AbstractSurfaceTerm": "physics.term",
    "AbstractExchangeTerm": "physics.term",
    "AbstractVolumeTerm": "physics.term",
    "AbstractPairTerm": "physics.term",
    "Binding": "physics.term",
    "Forcing": "physics.term",
    "Omitted": "physics.term",
    "Surface": "physics.term",
    "Sun": "physics.radiation.source",
    "PointSource": "physics.radiation.source",
    "AreaSource": "physics.radiation.area_source",
    "Surroundings": "physics.radiation.emission",
    "RadiativeExchange": "physics.radiation.radiative_exchange",
    "FixedTemperature": "physics.boundary",
    "HeatFlux": "physics.boundary",
    "Convection": "physics.boundary",
    "Wind": "physics.convection.wind",
    "WakeDeficit": "physics.convection.wake",
    "FreeConvection": "physics.convection.free_convection",
    "HeatSource": "physics.heat_source",
    "Contact": "physics.contact.links",
    "bonded": "physics.contact.links",
    "Pose": "geometry.mesh",
    "PoseTable": "scene.motion",
    "Motion": "scene.motion",
    "MaterialMap": "scene.scene",
    "MaterialLabels": "scene.scene",
    "Body": "scene.scene",
    "Scene": "scene.scene",
    "compile_scene": "scene.compile.compile",
    "ForwardEuler": "integrate.solvers",
    "SuperTimeStepping": "integrate.solvers",
    "BackwardEuler": "integrate.solvers",
    "TRBDF2": "integrate.solvers",
    "CrankNicolson": "integrate.solvers",
    "simulate": "integrate.run.simulate",
    "steady": "integrate.steady",
    "Solution": "integrate.run.solution",
    "SteadySolution": "integrate.run.solution",
    "RESULTS": "integrate.run.solution",
    "SurfaceError": "integrate.surface_error",
    "surface_error": "integrate.surface_error",
    "Camera": "image.camera",
    "OrthographicCamera": "image.camera",
    "render": "image.render",
    "write_exr": "image.files",
    "write_png": "image.files",
}
_MODULES = {"shapes": "geometry.shapes"}

__version__ = _version("jaxthermo")
__all__ = [*_HOME, *_MODULES, "__version__"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    elif name in _MODULES:
        value = importlib.import_module(f".{_MODULES[name]}", __name__)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)

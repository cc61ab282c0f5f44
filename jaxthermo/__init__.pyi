"""Types of all that `jaxthermo` exports; `__init__.py` resolves the same names."""

from .accuracy.discretization_error import (
    DiscretizationError as DiscretizationError,
    discretization_error as discretization_error,
)
from .accuracy.surface_error import (
    SurfaceError as SurfaceError,
    surface_error as surface_error,
)
from .accuracy.truth_error import TruthError as TruthError, truth_error as truth_error
from .compilation_cache import cache_compilations as cache_compilations
from .config.card_file import load_card as load_card
from .config.scene_file import SceneFile as SceneFile, load_scene as load_scene
from .console.progress import progress_bar as progress_bar
from .errors import InputError as InputError
from .flow.body import RoundBody as RoundBody
from .flow.channel import Channel as Channel
from .flow.run import FlowRun as FlowRun, simulate_flow as simulate_flow
from .geometry import shapes as shapes
from .geometry.equal_parts import (
    PlacedPart as PlacedPart,
    placed_parts as placed_parts,
)
from .geometry.load import load_mesh as load_mesh
from .geometry.mesh import Mesh as Mesh, Pose as Pose
from .geometry.parts import load_parts as load_parts
from .geometry.sample import MeshSample as MeshSample, mesh_sample as mesh_sample
from .image import measurements as measurements
from .image.colour.draw_measurements import (
    draw_measurements as draw_measurements,
    measure as measure,
)
from .image.colour.picture import picture as picture, write_png as write_png
from .image.detector.effects import (
    Blur as Blur,
    Counts as Counts,
    DetectorNoise as DetectorNoise,
    DiffractionBlur as DiffractionBlur,
    FixedPatternNoise as FixedPatternNoise,
)
from .image.files.animation import write_animation as write_animation
from .image.files.exr import write_exr as write_exr
from .image.files.flir_file import (
    FlirThermogram as FlirThermogram,
    read_flir as read_flir,
)
from .image.files.raster_files import (
    write_centikelvin as write_centikelvin,
    write_csv as write_csv,
    write_tiff as write_tiff,
)
from .image.files.surfaces import write_glb as write_glb, write_vtu as write_vtu
from .image.files.thermogram_files import read_thermogram as read_thermogram
from .image.radiance.atmosphere import (
    AirConstants as AirConstants,
    Atmosphere as Atmosphere,
)
from .image.radiance.band import Band as Band
from .image.radiance.directional import (
    AngularEmissivity as AngularEmissivity,
    SpecularReflection as SpecularReflection,
)
from .image.radiance.effect import BolometerLag as BolometerLag
from .image.radiance.thermography import (
    FlirCalibration as FlirCalibration,
    measured_radiance as measured_radiance,
    object_temperature as object_temperature,
)
from .image.render import frames as frames, render as render
from .image.surface.camera import (
    Camera as Camera,
    OrthographicCamera as OrthographicCamera,
)
from .integrate.run.abstract_solution import StoredSolution as StoredSolution
from .integrate.run.compiled_simulation import (
    CompiledSimulation as CompiledSimulation,
    compile_simulation as compile_simulation,
)
from .integrate.run.probe import probe as probe
from .integrate.run.simulate import simulate as simulate
from .integrate.run.solution import (
    RESULTS as RESULTS,
    Solution as Solution,
    SteadySolution as SteadySolution,
)
from .integrate.run.solution_file import load_run as load_run
from .integrate.solvers import (
    TRBDF2 as TRBDF2,
    BackwardEuler as BackwardEuler,
    CrankNicolson as CrankNicolson,
    ErrorControl as ErrorControl,
    ForwardEuler as ForwardEuler,
    SuperTimeStepping as SuperTimeStepping,
)
from .integrate.steady import steady as steady
from .integrate.steady_start import start_steady as start_steady
from .material.layer import Layer as Layer
from .material.material import Material as Material, Property as Property
from .material.stacks import stacks as stacks
from .material.table import materials as materials
from .memo.found import forget_findings as forget_findings
from .physics.boundary import (
    Convection as Convection,
    FixedTemperature as FixedTemperature,
    HeatFlux as HeatFlux,
)
from .physics.contact.links import Contact as Contact, bonded as bonded
from .physics.contact.seam import Seam as Seam
from .physics.convection.enclosed_air import EnclosedAir as EnclosedAir
from .physics.convection.free_convection import FreeConvection as FreeConvection
from .physics.convection.interior_air import InteriorAir as InteriorAir
from .physics.convection.linear_wind import LinearWind as LinearWind
from .physics.convection.wake import (
    FittedWake as FittedWake,
    WakeDeficit as WakeDeficit,
)
from .physics.convection.wind import Wind as Wind
from .physics.flux_law import AbstractFluxLaw as AbstractFluxLaw, Forcing as Forcing
from .physics.heat_source import HeatSource as HeatSource
from .physics.radiation.area_source import AreaSource as AreaSource
from .physics.radiation.diffuse_sky import DiffuseSky as DiffuseSky
from .physics.radiation.emission import Surroundings as Surroundings
from .physics.radiation.irradiation import (
    AbstractRadiativeTerm as AbstractRadiativeTerm,
    Irradiation as Irradiation,
)
from .physics.radiation.radiative_exchange import RadiativeExchange as RadiativeExchange
from .physics.radiation.source import PointSource as PointSource, Sun as Sun
from .physics.radiation.source_motion import (
    DirectionTable as DirectionTable,
    PointTable as PointTable,
)
from .physics.surface import Binding as Binding, Omitted as Omitted, Surface as Surface
from .physics.term import (
    AbstractExchangeTerm as AbstractExchangeTerm,
    AbstractPairTerm as AbstractPairTerm,
    AbstractSurfaceTerm as AbstractSurfaceTerm,
    AbstractVolumeTerm as AbstractVolumeTerm,
)
from .physics.time_varying import Table as Table, Until as Until
from .reduction.reduce import reduce as reduce
from .reduction.reduced_model import (
    ReducedModel as ReducedModel,
    load_reduced as load_reduced,
)
from .report.frame_sheet import frame_sheet as frame_sheet
from .scene.assembly import Rule as Rule, assembly as assembly
from .scene.body_materials import (
    MaterialLabels as MaterialLabels,
    MaterialMap as MaterialMap,
)
from .scene.coating import Coating as Coating
from .scene.compile.compile import compile_scene as compile_scene
from .scene.joints import joints as joints
from .scene.motion import Motion as Motion, PoseTable as PoseTable
from .scene.part_materials import materials_by_part as materials_by_part
from .scene.scene import Body as Body, Scene as Scene
from .structures.kinds.aggregate import Aggregate as Aggregate
from .structures.kinds.air import AirVolume as AirVolume
from .structures.kinds.full import FullVolume as FullVolume
from .structures.kinds.groups import (
    MultiLevel as MultiLevel,
    Octree as Octree,
    Partition as Partition,
    ShellOverCore as ShellOverCore,
)
from .structures.kinds.sheet import Sheet as Sheet
from .structures.kinds.shell import (
    IrregularMultiLevel as IrregularMultiLevel,
    SingleShell as SingleShell,
)
from .structures.kinds.skin import Skin as Skin
from .structures.surface_map import (
    ConstantMap as ConstantMap,
    FluxCorrectedMap as FluxCorrectedMap,
    LinearMap as LinearMap,
)
from .structures.weights import (
    ConductionWeights as ConductionWeights,
    FitCard as FitCard,
)
from .voxels.cylinders import Cylinder as Cylinder
from .voxels.fragment_mask import FragmentMask as FragmentMask
from .voxels.from_array import grid_from_voxels as grid_from_voxels
from .voxels.grid import VoxelGrid as VoxelGrid
from .voxels.selection import (
    Everything as Everything,
    Face as Face,
    Region as Region,
    Side as Side,
)
from .voxels.voxelize import voxelize as voxelize
from .weather.clear_sky import ClearSky as ClearSky
from .weather.outdoors import outdoors as outdoors
from .weather.sun_position import Place as Place, sun_path as sun_path

__version__: str

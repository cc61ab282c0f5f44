"""Every exported name in a script as a user writes it: pyright knows all the types."""

import numpy as np

import jaxthermo as jt


clay = jt.Material(conductivity=1.0, density=1900.0, specific_heat=835.0)
steel = jt.Material(jt.Property([280, 400], [15, 17]), 8000.0, 500.0, emissivity=0.3)
mesh: jt.Mesh = jt.shapes.box((0.1, 0.1, 0.2))
grid: jt.VoxelGrid = jt.voxelize(jt.load_mesh("a.obj", unit="mm") or mesh, pitch=0.01)
weights = jt.ConductionWeights(within=0.9)
card: jt.FitCard = jt.load_card("card.yaml")
labels = np.zeros(grid.solid.shape, np.int32)
coarse = (jt.SingleShell(grid), jt.MultiLevel(grid, levels=4), jt.Octree(grid))
blocks = (jt.Aggregate(grid, 4, weights=weights), jt.ShellOverCore(grid, 1, 4))
others = (jt.IrregularMultiLevel(grid, weights=card), jt.Partition(grid, labels))
maps = (jt.ConstantMap(), jt.LinearMap(at="voxel"), jt.FluxCorrectedMap())
painted = jt.MaterialMap(clay, ((jt.Region(lower=(0, 0, 0), upper=(1, 1, 1)), steel),))
scan: jt.VoxelGrid = jt.grid_from_voxels(np.ones((4, 4, 4), bool), pitch=0.01)
parts: dict[str, jt.Mesh] = jt.load_parts("knife.glb", unit="m", up="y")
by_part = jt.materials_by_part(grid, parts, {"blade": steel, "*": clay})
labelled = jt.MaterialLabels(labels, (clay, jt.materials["copper"]))
path = jt.PoseTable([0, 9], [jt.Pose(), jt.Pose((1.0, 0.0, 0.0))])
body = jt.Body(jt.FullVolume(grid), clay, temperature=293.0, surface_map=maps[2])
top, middle = jt.Side((0.0, 0.0, 1.0)), jt.Region((0, 0, 0), (0.1, 0.1, 0.1))
matt = jt.Coating(0.9, absorptivity=0.3, on=top & ~middle | jt.Side((1.0, 0.0, 0.0)))
coated = jt.Body(coarse[1], clay, temperature=293.0, coatings=(matt,))
moving = jt.Body(coarse[2], painted, temperature=300.0, pose=jt.Motion(path, every=1.0))
power = jt.Until(jt.Table([0, 60], [0, 1e3]), 90.0)
sun = jt.Sun(jt.DirectionTable([0, 9], [(0, 0, -1), (1, 0, -1)]), power)
lamp = jt.PointSource(jt.PointTable([0, 9], [(0, 0, 1), (1, 0, 1)]), 20.0)
panel = jt.AreaSource((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 1.0), temperature=600.0)
sky = jt.Surroundings(260.0, ground=lambda time: 280.0 + 0.01 * time)
wall = jt.FixedTemperature(350.0, on=jt.Side(normal=(0.0, 0.0, -1.0)))
flux = jt.HeatFlux(100.0, on=jt.FragmentMask(grid.fragment_position[:, 2] > 0.1))
cylinder = jt.Cylinder((0, 0, 0), (0, 0, 1), 0.05)
wind = jt.Wind((3.0, 0.0, 0.0), 290.0, cylinders=[cylinder], wake=jt.WakeDeficit())
air = (
    jt.Convection(10.0, 290.0),
    jt.FreeConvection(290.0),
    jt.RadiativeExchange(280.0),
)
heat = jt.HeatSource(5e3, within=jt.Everything() & ~middle)
terms = (sun, lamp, panel, sky, wall, flux, wind, *air, heat, jt.bonded)
scene = jt.Scene((body, moving), (*terms, jt.Contact(1e3, bodies=(0, 1))))
receipt = jt.compile_scene(scene).receipt
steps = (jt.ForwardEuler(), jt.SuperTimeStepping(), jt.BackwardEuler(60.0))
solution: jt.Solution = jt.simulate(scene, 90.0, (30.0, 90.0), solver=jt.TRBDF2())
exchange = jt.RadiativeExchange(280.0)
even: jt.SteadySolution = jt.steady(jt.Scene((body,), (exchange,)))
wired = jt.Scene((body,), (exchange,), probes={"core": (0, 0, 0)})
readings = jt.probe(jt.simulate(wired, 9.0), [(0.0, 0.0, 0.0), (0.0, 0.0, 0.1)])
reference = jt.simulate(scene, 90.0, solver=jt.CrankNicolson())
controlled = jt.simulate(scene, 90.0, solver=jt.ErrorControl(error=0.01))
error: jt.SurfaceError = jt.surface_error(solution, reference)
true: jt.TruthError = jt.truth_error(solution, reference, count=1000)
model: jt.ReducedModel = jt.reduce(scene, 90.0, [30.0, 90.0], tolerance=0.01)
model.save("model.npz")
reduced = jt.load_reduced("model.npz")()
estimated = jt.discretization_error(reference, solution, solution)
bounded: jt.DiscretizationError = estimated
sample: jt.MeshSample = jt.mesh_sample(mesh, count=100, seed=1)
on_mesh = jt.probe(even, sample.position, normals=sample.normal)
camera = jt.Camera((1.0, 0.2, 0.3), (0.0, 0.0, 0.1))
image = jt.render(solution, camera or jt.OrthographicCamera((1, 0, 0), (0, 0, 0), 0.4))
own = (jt.AbstractSurfaceTerm, jt.AbstractVolumeTerm, jt.AbstractFluxLaw, jt.Surface)
others_own = (jt.AbstractPairTerm, jt.AbstractExchangeTerm, jt.Binding, jt.Forcing)
radiant = (jt.AbstractRadiativeTerm, jt.Irradiation, solution.reflected(-1))
omitted = jt.Omitted("nothing to compute")
jt.write_png("frame.png", image, 280.0, 320.0)
jt.write_exr("frame.exr", image)
if solution.result != jt.RESULTS.successful:
    raise jt.InputError(f"jaxthermo {jt.__version__}: {solution.result}")

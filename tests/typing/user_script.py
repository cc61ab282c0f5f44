"""Every exported name in a script as a user writes it: pyright knows all the types."""

from datetime import UTC, datetime

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
irregular = (jt.IrregularMultiLevel(grid, weights=card), jt.Partition(grid, labels))
skin: jt.Skin = jt.Skin(coarse[2], cells=jt.Skin.cells_for(0.01, 6e-7, time=60.0))
maps = (jt.ConstantMap(), jt.LinearMap(at="voxel"), jt.FluxCorrectedMap())
painted = jt.MaterialMap(clay, ((jt.Region(lower=(0, 0, 0), upper=(1, 1, 1)), steel),))
scan: jt.VoxelGrid = jt.grid_from_voxels(np.ones((4, 4, 4), bool), pitch=0.01)
knife: dict[str, jt.Mesh] = jt.load_parts("knife.glb", unit="m", up="y")
by_part = jt.materials_by_part(grid, knife, {"blade": steel, "*": clay})


def solid(part: jt.Mesh) -> jt.FullVolume:
    return jt.FullVolume(jt.voxelize(part, pitch=1e-3))


copies: dict[str, jt.PlacedPart] = jt.placed_parts(knife)
handle_rules = [jt.Rule("blade", solid, material=steel), jt.Rule(["*"])]
blades: tuple[jt.Body, ...] = jt.assembly(knife, handle_rules, temperature=300.0)
labelled = jt.MaterialLabels(labels, (clay, jt.materials["copper"]))
ground: tuple[jt.Layer, ...] = jt.stacks["asphalt"]
path = jt.PoseTable([0, 9], [jt.Pose(), jt.Pose((1.0, 0.0, 0.0))])
body = jt.Body(jt.FullVolume(grid), clay, temperature=293.0, surface_map=maps[2])
panel = jt.Sheet(mesh, (jt.Layer(clay, thickness=1e-3),), pitch=0.01)
wall = jt.Body(panel, temperature=293.0)
top = jt.Side((0.0, 0.0, 1.0))
inner = jt.Convection(5.0, 290.0, on=jt.Face("back", body=1) & ~jt.Face("front", 1))
middle = jt.Region((0, 0, 0), (0.1, 0.1, 0.1))
matt = jt.Coating(0.9, absorptivity=0.3, on=top & ~middle | jt.Side((1.0, 0.0, 0.0)))
coated = jt.Body(coarse[1], clay, temperature=293.0, coatings=(matt,))
moving = jt.Body(coarse[2], painted, temperature=300.0, pose=jt.Motion(path, every=1.0))
power = jt.Until(jt.Table([0, 60], [0, 1e3]), 90.0)
sun = jt.Sun(jt.DirectionTable([0, 9], [(0, 0, -1), (1, 0, -1)]), power)
summer = datetime(2024, 6, 21, tzinfo=UTC)
by_date = jt.Sun(jt.sun_path(jt.Place(50.0, 8.0), summer, 3600.0), power)
hazy = jt.ClearSky((285.0, 300.0), turbidity=5.0)
outside = jt.outdoors(jt.Place(50.0, 8.0), summer, 3600.0, hazy)
daylight = jt.DiffuseSky(100.0, 30.0)
lamp = jt.PointSource(jt.PointTable([0, 9], [(0, 0, 1), (1, 0, 1)]), 20.0)
panel = jt.AreaSource((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 1.0), temperature=600.0)
sky = jt.Surroundings(260.0, ground=lambda time: 280.0 + 0.01 * time)
wall = jt.FixedTemperature(350.0, on=jt.Side(normal=(0.0, 0.0, -1.0)))
flux = jt.HeatFlux(100.0, on=jt.FragmentMask(grid.fragment_position[:, 2] > 0.1))
cylinder = jt.Cylinder((0, 0, 0), (0, 0, 1), 0.05)
wind = jt.Wind((3.0, 0.0, 0.0), 290.0, cylinders=[cylinder], wake=jt.WakeDeficit())
behind = jt.Wind((3.0, 0.0, 0.0), 290.0, wake=jt.FittedWake())
air = (
    jt.Convection(10.0, 290.0),
    jt.FreeConvection(290.0),
    jt.LinearWind(2.0, 290.0, calm=2.8, by_speed=3.0),
    jt.RadiativeExchange(280.0),
)
inside = jt.InteriorAir(5.0, 295.0, body=0)
cabin = jt.Body(jt.AirVolume(3.0), temperature=295.0)
aired = jt.EnclosedAir(5.0, 1e-4, 280.0, body=0, air=1)
heat = jt.HeatSource(5e3, within=jt.Everything() & ~middle)
terms = (sun, lamp, panel, sky, wall, flux, wind, *air, heat, jt.bonded)
scene = jt.Scene((body, moving), (*terms, jt.Contact(1e3, bodies=(0, 1))))
joined = jt.joints(blades, {("blade", "handle*"): 500.0}, default=None)
welds: tuple[jt.Seam, ...] = tuple(t for t in joined if isinstance(t, jt.Seam))
receipt = jt.compile_scene(scene).receipt
steps = (jt.ForwardEuler(), jt.SuperTimeStepping(), jt.BackwardEuler(60.0))
solution: jt.Solution = jt.simulate(scene, 90.0, (30.0, 90.0), solver=jt.TRBDF2())
exchange = jt.RadiativeExchange(280.0)
folder = "results/run"
solution.save(folder)
stored: jt.StoredSolution = jt.load_run(folder)
file: jt.SceneFile = jt.load_scene("scene.yaml", ["time.end=3 min"])
shown: jt.Solution = file.simulate(progress=jt.progress_bar)
even: jt.SteadySolution = jt.steady(jt.Scene((body,), (exchange,)))
warmed: jt.Scene = jt.start_steady(jt.Scene((body,), (exchange,)), [0], at=0.0)
if stored.receipt is not None and stored.run is not None:
    steps_taken: int = stored.run.steps
    included: tuple[str, ...] = stored.receipt.included
wired = jt.Scene((body,), (exchange,), probes={"core": (0, 0, 0)})
readings = jt.probe(jt.simulate(wired, 9.0), [(0.0, 0.0, 0.0), (0.0, 0.0, 0.1)])
run: jt.CompiledSimulation = jt.compile_simulation(scene, 90.0, (30.0, 90.0))
again: jt.Solution = run(scene, throw=False)
jt.forget_findings()
program_folder = jt.cache_compilations()
reference = jt.simulate(scene, 90.0, solver=jt.CrankNicolson())
controlled = jt.simulate(scene, 90.0, solver=jt.ErrorControl(error=0.01))
spread = jt.simulate(scene, 90.0, devices=1)
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
longwave = jt.Band((7.5e-6, 14e-6))
in_band = jt.render(solution, camera, band=longwave).apparent_temperature
glossy = (jt.AngularEmissivity(), jt.SpecularReflection(0.3, 100.0))
seen_through = (jt.Atmosphere(290.0), jt.Blur(0.4), jt.DiffractionBlur())
detector = (jt.BolometerLag(), jt.DetectorNoise(0.05), jt.FixedPatternNoise(0.02))
kelvin = jt.object_temperature(jt.measured_radiance(350.0, 0.9), 0.9)
flir: jt.FlirThermogram = jt.read_flir("a.jpg")
own_air = jt.Atmosphere(290.0, constants=jt.AirConstants(b=flir.calibration.b))
hot = flir.object_temperature(emissivity=0.9).max()
counted = jt.read_thermogram("f.png", "counts", jt.FlirCalibration()).mean()
effects = (*glossy, *seen_through, *detector, jt.Counts(280.0, 330.0))
measured = jt.render(solution, camera, samples=2, effects=effects)
brightest = [
    float(picture_of_time.radiance.max())
    for picture_of_time in jt.frames(solution, camera)
]
image = jt.render(solution, camera or jt.OrthographicCamera((1, 0, 0), (0, 0, 0), 0.4))
channel = jt.Channel((82, 440), 0.05, 0.05, body=jt.RoundBody((40.0, 40.0), 20.0))
flow: jt.FlowRun = jt.simulate_flow(channel, steps=9000)
own_terms = (
    jt.AbstractSurfaceTerm,
    jt.AbstractVolumeTerm,
    jt.AbstractFluxLaw,
    jt.Surface,
)
others_own = (jt.AbstractPairTerm, jt.AbstractExchangeTerm, jt.Binding, jt.Forcing)
radiant = (jt.AbstractRadiativeTerm, jt.Irradiation, solution.reflected(-1))
omitted = jt.Omitted("nothing to compute")
jt.write_png("frame.png", image, 280.0, 320.0)
jt.write_exr("frame.exr", image)
jt.write_vtu("surface.vtu", solution, index=0)
jt.write_glb("surface.glb", solution, low=290.0, high=320.0, palette="ember")
above: int = jt.write_centikelvin("frame.png", image, saturate=True)
jt.write_tiff("frame.tiff", image, "surface")
jt.write_csv("frame.csv", image)
spot = jt.measurements.Spot((0.5, 0.4))
rim = jt.measurements.Isotherm(above=310.0)
warmest: float = jt.measure(image, [spot])["Sp1"].max
drawn = jt.draw_measurements(jt.picture(image, 280.0, 320.0), image, [spot, rim])
frame_count: int = jt.write_animation("frames.gif", [drawn, drawn], palette="iron")
jt.frame_sheet([image], 280.0, 320.0).save("sheet.png")
if solution.result != jt.RESULTS.successful:
    raise jt.InputError(f"jaxthermo {jt.__version__}: {solution.result}")

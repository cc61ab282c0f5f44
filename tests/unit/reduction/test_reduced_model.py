"""Reduced models: exact at full size, errors, bounds, other loads, files, refusals."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import bar, blocks

import jaxthermo as jt
from jaxthermo.reduction.reduced_file import read_model, write_model


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
SAVES = [5.0, 20.0, 60.0]
HEATED = jt.HeatFlux(jt.Until(2e4, 20.0), on=jt.Side((1, 0, 0)))
AIR = jt.Convection(50.0, 280.0)
SOLVER = jt.SuperTimeStepping(dt=0.05)


def block_scene(*terms, **options):
    solid = np.ones((6, 4, 4), bool)
    body = jt.Body(jt.FullVolume(blocks(solid, 0.005)), STEEL, temperature=290.0)
    return jt.Scene((body,), terms or (HEATED, AIR), dtype="float64", **options)


def kelvin(solution):
    return np.asarray(solution.surface_temperature)


def rms(gap):
    return np.sqrt((gap**2).mean(axis=-1))


@pytest.fixture(scope="module")
def scene():
    return block_scene()


@pytest.fixture(scope="module")
def complete_model(scene):
    """A model with as many vectors as its loads can reach."""
    return jt.reduce(scene, 60.0, SAVES, size=96)


@pytest.fixture(scope="module")
def full(scene):
    return jt.simulate(scene, 60.0, SAVES, solver=SOLVER)


@pytest.fixture(scope="module")
def model(scene):
    return jt.reduce(scene, 60.0, SAVES, tolerance=1e-3)


def test_all_vectors_are_the_full_structure(complete_model, full):
    assert kelvin(complete_model) == pytest.approx(kelvin(full), abs=2e-4)
    # The start, at which no load has acted on the surface.
    assert kelvin(complete_model({}, [0.0]))[0] == pytest.approx(290.0)
    assert jt.truth_error(complete_model(), full).worst_rms_kelvin < 2e-4


def scenes_of_everything():
    """Scenes whose parts each have a pattern of their own."""
    grid = blocks(np.ones((4, 4, 4), bool), 0.005)
    below = jt.Body(jt.FullVolume(grid), STEEL, temperature=300.0)
    above = jt.Body(
        jt.Aggregate(grid, factor=2),
        STEEL,
        temperature=340.0,
        pose=jt.Pose((0.0, 0.0, 0.02)),
        # A gradient is limited where a solution is read, and not in reduced models.
        surface_map=jt.ConstantMap(),
    )
    warm = jt.Table([0.0, 30.0, 60.0], [290.0, 330.0, 300.0])
    terms = (jt.Contact(2000.0), jt.Convection(20.0, warm))
    yield "contact of two temperatures, air by a table", jt.Scene((below, above), terms)
    uneven = replace(below, temperature=lambda x: 300.0 + 1000.0 * x[:, 0])
    held = jt.FixedTemperature(310.0, on=jt.Side((-1, 0, 0)))
    inside = jt.HeatSource(jt.Until(2e6, 20.0))
    yield "uneven start, fixed, source", jt.Scene((uneven,), (held, inside, AIR))
    shone = jt.Sun((-1.0, 0.2, -0.5), irradiance=jt.Until(3e3, 20.0))
    yield (
        "sun on an aggregate",
        jt.Scene((replace(above, pose=jt.Pose()),), (shone, AIR)),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(scene, id=name, marks=[pytest.mark.slice] * ("uneven" in name))
        for name, scene in scenes_of_everything()
    ],
)
def test_every_linear_mechanism_is_the_same_as_in_the_full_run(scene):
    scene = replace(scene, dtype="float64")
    actual = jt.reduce(scene, 60.0, SAVES, tolerance=1e-6)
    run = jt.simulate(scene, 60.0, SAVES, solver=SOLVER)
    size = np.ptp(kelvin(run), axis=1).max()
    assert kelvin(actual) == pytest.approx(kelvin(run), abs=2e-4 * size)


@pytest.mark.parametrize(
    "method", ["krylov", pytest.param("pod", marks=pytest.mark.slow)]
)
def test_the_error_falls_with_the_size_and_is_known(scene, complete_model, method):
    errors = []
    for size in (2, 4, 8):
        small = jt.reduce(scene, 60.0, SAVES, size=size, method=method)
        assert small.size == small.about.size == size
        error = rms(kelvin(small) - kelvin(complete_model))
        estimate = np.array(small.about.estimate_kelvin)
        assert (abs(estimate - error) < 0.3 * error + 1e-5).all()
        errors.append(error.max())
    assert errors[1] < errors[0] / 4 and errors[2] < errors[1] / 4


def test_snapshots_warn_of_loads_that_they_have_not_seen(scene, complete_model):
    model = jt.reduce(scene, 60.0, SAVES, size=6, method="pod")
    assert kelvin(model()) == pytest.approx(kelvin(model))
    name = model.inputs[0].name
    loads = {name: jt.Until(3 * np.abs(model.amplitudes[:, 0]).max(), SAVES[0])}
    with pytest.warns(UserWarning, match="method='pod'.*not hold for other loads"):
        off = kelvin(model(loads))
    # Their error exceeds the stated one.
    error = rms(off - kelvin(complete_model(loads))).max()
    assert error > max(model.about.estimate_kelvin)
    with pytest.warns(UserWarning, match="method='pod'"):
        model.as_function()


def test_snapshots_warn_of_starts_that_they_have_not_seen(scene):
    body = scene.bodies[0]
    grid = body.structure.grid
    middle = grid.lattice.centres(np.argwhere(grid.solid))[:, 0].mean()
    # Of the same mean, from which the model counts.
    uneven = replace(body, temperature=lambda x: 290.0 + 100.0 * (x[:, 0] - middle))
    other = replace(scene, bodies=(uneven,))
    # The start of the other scene is in the span of the model then.
    model = jt.reduce(scene, 60.0, SAVES, size=6, method="pod").extend(other)
    model.simulate(scene)
    with pytest.warns(UserWarning, match="method='pod'.*not hold for other starts"):
        model.simulate(other)


def test_the_residual_bounds_the_error_of_the_volume(scene, complete_model):
    exact = complete_model.offline
    for size in (2, 3, 5):
        small = jt.reduce(scene, 60.0, SAVES, size=size)
        bound = np.array(small.about.residual_bound_kelvin)
        error = volume_error(small, exact)
        assert (bound >= error).all()
        # Its effectivity: within an order of magnitude.
        assert (bound <= 12 * error).all()


def volume_error(small, exact):
    """Root mean square over the volume of the difference of two models [K]."""
    states = [states_of(offline) for offline in (small.offline, exact)]
    capacity = exact.target.system.capacity
    gap = states[0] - states[1]
    return np.sqrt((gap**2) @ capacity / capacity.sum())


def states_of(offline):
    from jaxthermo.reduction.basis import project
    from jaxthermo.reduction.modal_run import host_run

    target = offline.target
    modes = project(target.system, offline.basis)
    states = host_run(
        modes.rates,
        drive=modes.drive,
        start=modes.start,
        plan=target.plan,
        amplitudes=target.amplitudes,
    )
    return states[target.plan.saved] @ modes.basis.vectors.T


def test_a_tolerance_chooses_the_size(scene, complete_model, model):
    span = np.ptp(kelvin(complete_model), axis=1)
    assert (rms(kelvin(model) - kelvin(complete_model)) / span).max() < 1.5e-3
    assert model.about.estimate_percent <= 0.1
    finer = jt.reduce(scene, 60.0, SAVES, tolerance=1e-5)
    assert model.size < finer.size < model.about.nodes / 3
    assert model.about.offline_s > 0 and model.about.method == "krylov"


def test_the_projection_stays_symmetric_and_loses_heat(model):
    offline = model.offline
    vectors = offline.basis.vectors
    capacity = offline.target.system.capacity
    assert vectors.T @ (capacity[:, None] * vectors) == pytest.approx(
        np.eye(model.size), abs=1e-10
    )
    reduced = vectors.T @ offline.basis.conducted
    assert reduced == pytest.approx(np.diag(model.rates), abs=1e-10 * model.rates.max())
    assert (model.rates > 0).all()


def test_other_amplitudes_of_the_same_patterns(model):
    stronger = jt.HeatFlux(
        jt.Table([0.0, 20.0, 60.0], [0.0, 3e4, 1e4]), on=jt.Side((1, 0, 0))
    )
    windier_scene = block_scene(stronger, jt.Convection(50.0, 285.0))
    run = jt.simulate(windier_scene, 60.0, SAVES, solver=SOLVER)
    close = {"abs": 3e-3 * np.ptp(kelvin(run), axis=1).max()}
    assert kelvin(model.simulate(windier_scene)) == pytest.approx(kelvin(run), **close)
    # The same by hand, in the units of the inputs.
    names = [(load.name, load.unit) for load in model.inputs]
    assert names == [("heat_flux", "W/m^2"), ("convection", "K above the start's mean")]
    loads = {"heat_flux": stronger.heat_flux, "convection": -5.0}
    assert kelvin(model(loads)) == pytest.approx(kelvin(run), **close)
    with pytest.raises(jt.InputError, match="no input 'sun'; there are heat_flux"):
        model({"sun": 1.0})
    with pytest.raises(jt.InputError, match="save times lie between 0 and 60 s"):
        model(save_at=[61.0])


BESIDE = jt.HeatFlux(2e4, on=jt.Side((0, 0, 1)))


def test_loads_outside_of_the_span_are_refused(model):
    with pytest.raises(jt.InputError, match=r"pattern of heat_flux .*extend\(scene\)"):
        model.simulate(block_scene(BESIDE, AIR))


@pytest.mark.slow
@pytest.mark.slice
def test_loads_outside_of_the_span_extend_it(model):
    extended_scene = block_scene(BESIDE, AIR)
    wider = model.extend(extended_scene)
    assert wider.size > model.size
    assert [load.name for load in wider.inputs][2:] == ["heat_flux 2"]
    run = jt.simulate(extended_scene, 60.0, SAVES, solver=SOLVER)
    close = {"abs": 3e-3 * np.ptp(kelvin(run), axis=1).max()}
    assert kelvin(wider.simulate(extended_scene)) == pytest.approx(kelvin(run), **close)
    # Its own scene is as it was, or better.
    assert kelvin(wider) == pytest.approx(kelvin(model), **close)


def test_other_bodies_and_coefficients_need_a_model_of_their_own(model):
    scene = block_scene()
    windier = block_scene(HEATED, jt.Convection(80.0, 280.0))
    warmer = replace(scene, bodies=(replace(scene.bodies[0], temperature=300.0),))
    grid = blocks(np.ones((5, 4, 4), bool), 0.005)
    shorter = replace(scene.bodies[0], structure=jt.FullVolume(grid))
    for changed_scene, words in (
        (windier, "coefficient of heat transfer"),
        (warmer, "another mean temperature"),
        (replace(scene, bodies=(shorter,)), "other bodies"),
    ):
        for call in (model.simulate, model.extend):
            with pytest.raises(jt.InputError, match=words):
                call(changed_scene)


def test_the_function_is_transformed_by_jax(model):
    function = jax.jit(model.as_function())
    loads = jnp.asarray(model.amplitudes)
    expected = kelvin(model)
    assert np.asarray(function(loads)) == pytest.approx(expected)
    surfaces = jax.jit(jax.vmap(function))(jnp.stack([loads, 2 * loads]))
    assert np.asarray(surfaces[0]) == pytest.approx(expected)
    # Linear in the loads: from the start's temperature of 290 K.
    assert np.asarray(surfaces[1]) - 290 == pytest.approx(2 * (expected - 290))

    @jax.jit
    def hottest(loads):
        return (function(loads)[1] ** 2).mean()

    gradient = jax.grad(hottest)(loads)
    way = jnp.asarray(np.random.default_rng(1).normal(size=loads.shape))
    step = 1e-3
    slope = (hottest(loads + step * way) - hottest(loads - step * way)) / (2 * step)
    assert float((gradient * way).sum()) == pytest.approx(float(slope), rel=1e-6)
    # Other knots and times.
    short = jax.jit(model.as_function((0.0, 10.0), (10.0,)))
    assert np.asarray(short(jnp.zeros((2, 2)))) == pytest.approx(290.0)


def test_a_float32_scene_has_a_float32_model(model):
    single = replace(model, dtype="float32")
    actual = jax.jit(single.as_function())(jnp.asarray(model.amplitudes, "float32"))
    assert actual.dtype == jnp.float32
    assert np.asarray(actual) == pytest.approx(kelvin(model), abs=1e-3)


def test_a_file_holds_the_whole_model(model, full, tmp_path):
    path = tmp_path / "model.npz"
    model.save(path)
    read = jt.load_reduced(path)
    assert np.array_equal(kelvin(read), kelvin(model))
    assert read.about == model.about and read.inputs == model.inputs
    assert read.knots == model.knots and read.times == model.times
    assert jt.surface_error(read(), full).worst_rms_percent < 1
    for call in (read.simulate, read.extend):
        with pytest.raises(jt.InputError, match="reduce\\(\\) the scene again"):
            call(block_scene())
    with np.load(path) as stored:
        arrays = dict(stored)
    # A state space that any program can step.
    assert arrays["A"] == pytest.approx(np.diag(-model.rates))
    assert arrays["B"].shape == (model.size, 2)


@pytest.mark.parametrize("damage", ["cut", "changed", "missing"])
def test_a_damaged_file_is_refused_in_one_line(model, tmp_path, damage):
    path = tmp_path / "model.npz"
    model.save(path)
    data = path.read_bytes()
    if damage == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "changed":
        with np.load(path) as stored:
            arrays = dict(stored)
        np.savez(path, allow_pickle=False, **{**arrays, "A": 2 * arrays["A"]})
    else:
        path.unlink()
    with pytest.raises(jt.InputError) as refused:
        jt.load_reduced(path)
    assert "\n" not in str(refused.value) and "model.npz" in str(refused.value)


def test_a_file_of_other_numbers_is_refused(model, tmp_path):
    path = tmp_path / "model.npz"
    model.save(path)
    fields = read_model(path)
    assert fields.dtype == model.dtype
    write_model(path, replace(fields, dtype="float16"))
    with pytest.raises(jt.InputError, match="its texts are missing or damaged"):
        jt.load_reduced(path)


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        ((AIR, jt.Surroundings(280.0)), "emission is not linear"),
        ((jt.FreeConvection(280.0),), "free_convection is not linear"),
        ((jt.Convection(jt.Until(10.0, 5.0), 280.0),), "convection is not linear"),
        ((jt.RadiativeExchange(280.0),), "radiative_exchange is not linear"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_not_linear_is_refused_by_name(terms, words):
    with pytest.raises(jt.InputError, match=words) as refused:
        jt.reduce(block_scene(*terms), 60.0)
    assert "\n" not in str(refused.value)


def test_moving_bodies_and_bad_options_are_refused(scene):
    law = jt.Property((200.0, 400.0), (10.0, 20.0))
    steel = jt.Material(law, density=8000.0, specific_heat=500.0)
    varying = replace(scene.bodies[0], material=steel)
    with pytest.raises(jt.InputError, match="material of body 0 varies"):
        jt.reduce(replace(scene, bodies=(varying,)), 60.0)
    moved = jt.Motion(jt.PoseTable((0.0, 60.0), (jt.Pose(), jt.Pose((0.1, 0.0, 0.0)))))
    body = jt.Body(jt.FullVolume(bar(2, 0.01)), STEEL, temperature=290.0, pose=moved)
    shone = jt.Sun((-1.0, 0.0, 0.0), irradiance=100.0)
    with pytest.raises(jt.InputError, match="moves"):
        jt.reduce(jt.Scene((body,), (shone,)), 60.0)
    mistakes: list[tuple[dict[str, Any], str]] = [
        ({"size": 0}, "size=0"),
        ({"tolerance": 0.0}, "tolerance=0"),
        ({"tolerance": 0.1, "size": 3}, "not both"),
        ({"method": "dmd"}, "method='dmd'"),
        ({"save_at": [70.0]}, "save_at"),
    ]
    for given, words in mistakes:
        with pytest.raises(jt.InputError, match=words):
            jt.reduce(scene, 60.0, **given)
    with pytest.raises(jt.InputError, match="nothing to reduce"):
        jt.reduce(block_scene(jt.Convection(50.0, 290.0)), 60.0)
    with pytest.raises(jt.InputError, match="end time above 0"):
        jt.reduce(scene, 0.0)

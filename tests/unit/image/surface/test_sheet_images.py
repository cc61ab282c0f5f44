"""Images of thin walls: two sides, borders, creases, and rooms from within."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.image.pose.coverage import coverage
from jaxthermo.image.radiance.directional import SpecularReflection
from jaxthermo.image.surface.view import compute_view
from jaxthermo.image.surface.visible import world_meshes
from jaxthermo.integrate.run.solution_file import load_solution


METAL = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.9)
FOAM = jt.Material(0.03, 40.0, specific_heat=1400.0, emissivity=0.9)
THIN = (jt.Layer(METAL, 1e-3),)
# Front and back far from each other.
THICK = (jt.Layer(FOAM, 0.1),)


def rectangle(x=1.0, y=0.5):
    corners = np.array([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0]], float)
    return jt.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def camera_above(height, **options):
    """A camera over the middle of the rectangle, or below it."""
    options = {"width": 120, "height": 80, "field_of_view": 0.5} | options
    return jt.Camera((0.5, 0.25, height), (0.5, 0.25, 0.0), up=(0, 1, 0), **options)


def by_height(position):
    """Warm at the top, cold at the bottom of a wall, by the layer of its cells."""
    n = len(position) // 2
    return np.repeat([400.0, 300.0], n)


def solved(*bodies):
    return jt.simulate(jt.Scene(bodies, (), dtype="float64"), 0.0)


@pytest.fixture(scope="module")
def wall():
    sheet = jt.Sheet(rectangle(), THICK, 0.1, cells=2)
    return solved(jt.Body(sheet, temperature=by_height))


def seen(image):
    return np.asarray(image.object_id) >= 0


@pytest.mark.parametrize(("height", "kelvin"), [(1.5, 400.0), (-1.5, 300.0)])
@pytest.mark.parametrize("smooth", [True, False])
def test_each_side_shows_its_own_temperature(wall, height, kelvin, smooth):
    image = jt.render(wall, camera_above(height), smooth=smooth)
    on_wall = seen(image)
    assert on_wall.sum() > 1000
    assert_allclose(np.asarray(image.temperature)[on_wall], kelvin)
    # The normal of the side that is seen.
    normal = np.asarray(image.normal)[on_wall]
    assert_allclose(normal, np.broadcast_to([0, 0, np.sign(height)], normal.shape))


@pytest.mark.parametrize("height", [1.5, -1.5])
def test_a_linear_field_is_read_up_to_the_border(height):
    def linear(position):
        return 300 + position @ [100.0, 40.0, 0.0]

    body = jt.Body(jt.Sheet(rectangle(), THIN, 0.1), temperature=linear)
    camera = camera_above(height)
    image = jt.render(solved(body), camera)
    on_sheet = seen(image).ravel()
    origin, step = (rays[on_sheet] for rays in camera.rays())
    point = origin - (origin[:, 2] / step[:, 2])[:, None] * step
    error = np.asarray(image.temperature).ravel()[on_sheet] - linear(point)
    # Of a range of 120 K.
    assert np.abs(error).max() < 1e-3


def test_a_distorting_lens_sees_both_sides(wall):
    camera = camera_above(-1.5, distortion=(-0.2, 0.1, 0.0, 0.0))
    image = jt.render(wall, camera)
    assert_allclose(np.asarray(image.temperature)[seen(image)], 300.0)


def cabinet(temperature=by_height):
    box = jt.shapes.box((2.0, 2.0, 2.0))
    sheet = jt.Sheet(box, THICK, 0.25, cells=2)
    return solved(jt.Body(sheet, temperature=temperature))


def test_a_camera_in_a_room_sees_its_inner_side():
    inside = jt.Camera(
        (0.0, 0.0, 0.0), (1.0, 0.2, 0.1), field_of_view=1.5, width=40, height=30
    )
    outside = jt.Camera((5.0, 1.0, 1.0), (0.0, 0.0, 0.0), width=40, height=30)
    room = cabinet()
    within = jt.render(room, inside)
    assert seen(within).all()
    assert_allclose(within.temperature, 300.0)
    # It faces the camera.
    _, step = inside.rays()
    assert ((np.asarray(within.normal).reshape(-1, 3) * step).sum(1) < 0).all()
    around = jt.render(room, outside)
    assert_allclose(np.asarray(around.temperature)[seen(around)], 400.0)


def test_a_camera_in_a_solid_is_refused_as_before():
    grid = jt.voxelize(jt.shapes.box((1.0, 1.0, 1.0)), 0.25)
    solid = solved(jt.Body(jt.FullVolume(grid), METAL, temperature=300.0))
    with pytest.raises(jt.InputError, match="inside body 0"):
        jt.render(solid, jt.Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))


def test_sides_of_a_box_do_not_mix_at_its_edges():
    """A cell over an edge is one node, and no value comes from beyond it."""

    # The side that is seen constant up to its edges, its neighbours warmer or colder.
    def by_side(position):
        x, y, _ = np.abs(position[: len(position) // 2]).T
        kelvin = np.where(x > 0.99, 350.0, np.where(y > 0.99, 400.0, 300.0))
        return np.tile(kelvin, 2)

    room = cabinet(by_side)
    camera = jt.OrthographicCamera((5, 0, 0), (0, 0, 0), 2.0, width=80, height=80)
    kelvin = np.asarray(jt.render(room, camera).temperature)
    assert_allclose(kelvin, 350.0)


def test_sheets_that_face_each_other_are_apart():
    """Two leaves of one mesh, with equal normals and a gap of less than two cells."""
    leaf = rectangle()
    both = jt.Mesh(
        np.concatenate([leaf.vertices, leaf.vertices - [0, 0, 0.1]]),
        np.concatenate([leaf.faces, leaf.faces + 4]),
    )

    def by_leaf(position):
        return np.where(position[:, 2] > -0.05, 350.0, 310.0)

    pair = solved(jt.Body(jt.Sheet(both, THIN, 0.1), temperature=by_leaf))
    above = jt.render(pair, camera_above(1.5))
    below = jt.render(pair, camera_above(-1.5))
    middle = (slice(30, 50), slice(40, 80))
    assert_allclose(np.asarray(above.temperature)[middle], 350.0)
    assert_allclose(np.asarray(below.temperature)[middle], 310.0)


def test_parts_have_numbers_on_both_sides():
    left = rectangle(0.5)
    parts = {"left": left, "right": left.moved((0.5, 0.0, 0.0))}
    body = jt.Body(jt.Sheet(parts, {"*": THIN}, 0.1), temperature=300.0)
    solution = solved(body)
    for height in (1.5, -1.5):
        camera = camera_above(height)
        image = jt.render(solution, camera)
        assert image.part_names == (("left", "right"),)
        part = np.asarray(image.part_id)
        row, column = np.nonzero(seen(image))
        origin, step = camera.rays(row * camera.width + column)
        x = origin[:, 0] - origin[:, 2] / step[:, 2] * step[:, 0]
        apart = np.abs(x - 0.5) > 0.05
        assert_allclose(part[row, column][apart], (x > 0.5)[apart])


def test_a_stored_solution_has_two_sides(wall, tmp_path):
    wall.save(tmp_path)
    (surface,) = load_solution(tmp_path / "solution.npz").surfaces
    assert surface.geometry.is_two_sided
    assert_allclose(
        surface.geometry.surface_faces, wall.surfaces[0].geometry.surface_faces
    )


def test_coverage_counts_a_sheet_from_both_sides(wall):
    bodies = world_meshes(wall.surfaces)
    front, back = (coverage(bodies, camera_above(z), 2).fraction for z in (1.5, -1.5))
    assert_allclose(front, back[:, ::-1], atol=0.26)
    assert front.sum() == pytest.approx(back.sum(), rel=1e-3)


@pytest.mark.parametrize(("height", "radiance"), [(1.5, "sky"), (-1.5, "ground")])
def test_a_mirror_shows_what_its_side_faces(height, radiance):
    """A cold mirror above shows the sky, below the ground."""
    mirror = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.02)
    sheet = jt.Sheet(rectangle(), (jt.Layer(mirror, 1e-3),), 0.1)
    scene = jt.Scene(
        (jt.Body(sheet, temperature=300.0),),
        (jt.Surroundings(250.0, ground=320.0),),
        dtype="float64",
    )
    effects = (SpecularReflection(fraction=1.0, exponent=1000.0),)
    image = jt.render(jt.simulate(scene, 0.0), camera_above(height), effects=effects)
    shown = np.asarray(image.apparent_temperature)[seen(image)]
    assert_allclose(shown, 250.0 if radiance == "sky" else 320.0, atol=3.0)


@pytest.mark.parametrize("inside", [True, False])
def test_a_glossy_room_mirrors_its_walls_and_no_sky(inside, tmp_path):
    """Walls of one temperature: inside all that is seen has it, sky is outside."""
    shiny = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.1)
    room = jt.Sheet(jt.shapes.box((2.0, 2.0, 2.0)), (jt.Layer(shiny, 1e-3),), 0.5)
    scene = jt.Scene(
        (jt.Body(room, temperature=300.0),),
        (jt.RadiativeExchange(250.0, ground=350.0),),
        dtype="float64",
    )
    solution = jt.simulate(scene, 0.0)
    solution.save(tmp_path)
    (stored,) = load_solution(tmp_path / "solution.npz").surfaces
    enclosed = stored.geometry.is_enclosed
    assert_array_equal(enclosed, solution.surfaces[0].geometry.is_enclosed)
    distance = 0.0 if inside else 5.0
    camera = jt.Camera((distance, 0.0, 0.0), (-1.0, 0.2, 0.1), width=40, height=30)
    effects = (SpecularReflection(fraction=1.0, exponent=50.0),)
    image = jt.render(solution, camera, effects=effects)
    kelvin = np.asarray(image.apparent_temperature)[seen(image)]
    if inside:
        assert_allclose(kelvin, 300.0, atol=0.05)
    else:
        assert np.ptp(kelvin) > 10.0


def test_surfaces_in_the_image_hide_what_is_behind_a_sheet():
    """In the corner of two sheets half of the surroundings is hidden, on that side."""
    floor = rectangle(1.0, 1.0)
    post = jt.Mesh(floor.vertices[:, [2, 1, 0]], floor.faces)
    sheets = [jt.Sheet(mesh, THIN, 0.1) for mesh in (floor, post)]
    pair = solved(*(jt.Body(sheet, temperature=300.0) for sheet in sheets))
    centre = np.array([0.03, 0.5, 0.0])
    open_fraction = []
    for height in (1.0, -1.0):
        camera = jt.Camera(
            tuple(centre + [0.9, 0.0, height]), tuple(centre), width=80, height=60
        )
        view = compute_view(pair.surfaces, (), camera, occlusion=2.0)
        assert view.open_fraction is not None
        pixel = 30 * 80 + 40
        (at,) = np.flatnonzero(view.pixel == pixel)
        assert view.body[at] == 0
        open_fraction.append(view.open_fraction[at])
    above, below = open_fraction
    assert above == pytest.approx(0.5, abs=0.1)
    assert below == pytest.approx(1.0, abs=0.02)

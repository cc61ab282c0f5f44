"""Bodies from the parts of a mesh file, by rules, and their names in terms."""

import json

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.config.loader import load_config, to_yaml
from jaxthermo.errors import InputError
from tests.assemblies import NAMES, cart, write_cart


WHEELS = "{match: 'wheel*', material: copper}"
ROOF = "{match: roof, sheet: {layers: [{material: copper, thickness: 1 mm}], cells: 1}}"
DECAL = "{match: decal, ignore: true}"
CONVECTION = "kind: convection, heat_transfer_coefficient: 5, temperature: 290"


def text(rules, terms=(), assembly="pitch: 4 cm, temperature: 300", bodies=()):
    lines = ["bodies:", *(f"  - {body}" for body in bodies)] if bodies else []
    lines += [
        "assembly:",
        "  mesh: {path: cart.glb, unit: m}",
        *(f"  {option}" for option in assembly.split(", ") if option),
        "  parts:",
        *(f"    - {rule}" for rule in rules),
        *(["terms:"] if terms else []),
        *(f"  - {{{term}}}" for term in terms),
        "time: {end: 60, save_every: 60}",
    ]
    return "\n".join(lines) + "\n"


@pytest.fixture
def scene(tmp_path):
    """A function from rules and more to the config, which is written out again."""
    write_cart(tmp_path)
    path = tmp_path / "scene.yaml"

    def load(*arguments, **options):
        path.write_text(text(*arguments, **options))
        config = load_config(path)
        path.write_text(to_yaml(config))
        assert load_config(path) == config
        return config

    return load


def test_parts_are_bodies_by_the_first_rule_that_matches(scene):
    rules = ("{match: wheel_small, material: brick, pitch: 2 cm}", WHEELS, ROOF, DECAL)
    config = scene(rules)
    assert [body.name for body in config.bodies] == NAMES[:4]
    built = config.build()
    left, right, small, roof = built.bodies
    assert [body.name for body in built.bodies] == NAMES[:4]
    # Two wheels are one mesh, voxelized once; the third has another scale.
    assert left.structure is right.structure
    assert left.structure is not small.structure
    assert small.structure.grid.pitch == pytest.approx(0.02)
    assert left.structure.grid.pitch == roof.structure.grid.pitch == 0.04
    assert small.material.conductivity < left.material.conductivity
    assert isinstance(roof.structure, jt.Sheet)


def test_instances_are_where_the_file_has_them(scene):
    config = scene((WHEELS, ROOF, DECAL))
    meshes = jt.load_parts(config.bodies[0].mesh.path, unit="m")
    for body, built in zip(config.bodies, config.build().bodies, strict=True):
        own = built.structure.grid.mesh
        expected = meshes[body.mesh.part]
        placed = own.placed(built.pose)
        assert placed.vertices == pytest.approx(expected.vertices, abs=1e-6)
    right = config.build().bodies[1]
    lower, upper = right.structure.grid.mesh.placed(right.pose).bounds
    # Turned by a quarter about z, below a node at x = 1.
    assert np.round(upper - lower, 6).tolist() == [0.04, 0.2, 0.2]
    assert (lower + upper)[0] == pytest.approx(2.0)


def test_a_part_that_moves_has_the_frame_of_the_file(scene):
    poses = "[{translation: [0, 0, 0]}, {translation: [1, 0, 0]}]"
    motion = f"pose: {{times: [0, 60], poses: {poses}}}"
    rules = (f"{{match: wheel_right, material: copper, {motion}}}", WHEELS, ROOF, DECAL)
    left, right, *_ = scene(rules).build().bodies
    assert isinstance(right.pose, jt.Motion)
    assert left.structure is not right.structure
    assert right.structure.grid.mesh.bounds.mean(axis=0)[0] == pytest.approx(1.0)


def test_a_pose_of_a_rule_comes_after_that_of_the_part(scene):
    pose = "pose: {translation: [0, 0, 2], rotation: {axis: [1, 0, 0], angle: 90 deg}}"
    moved = scene((f"{{match: 'wheel*', material: copper, {pose}}}", ROOF, DECAL))
    still = scene((WHEELS, ROOF, DECAL))
    after = jt.Pose.about((1.0, 0.0, 0.0), np.pi / 2, (0.0, 0.0, 2.0))
    pairs = zip(still.build().bodies[:3], moved.build().bodies[:3], strict=True)
    for body, body_after in pairs:
        mesh = body.structure.grid.mesh
        expected = mesh.placed(body.pose).placed(after).vertices
        assert mesh.placed(body_after.pose).vertices == pytest.approx(expected)


def test_listed_bodies_come_first_and_skins_follow_the_scene(scene):
    box = "{shape: {kind: box, size: [1, 1, 1]}, pitch: 0.5, material: brick, name: x,"
    rules = ("{match: 'wheel*', material: copper, skin: 2}", ROOF, DECAL)
    config = scene(rules, bodies=(f"{box} temperature: 280}}",))
    assert [body.name for body in config.bodies] == ["x", *NAMES[:4]]
    assert config.bodies[1].skin is not None
    assert config.bodies[1].skin.shortest_time == 60.0


def test_terms_select_bodies_by_name(scene):
    up = "side: {normal: [0, 0, 1], part: 'wheel_?*'}"
    face = "{face: {name: back, part: roof}}"
    terms = (
        f"{CONVECTION}, on: {{part: 'wheel*'}}",
        f"{CONVECTION}, on: {{all: [{{part: roof}}, {face}]}}",
        f"{CONVECTION}, on: {{{up}}}",
        "kind: heat_source, heat_rate_density: 10, within: {part: [wheel_left, roof]}",
        "kind: contact, conductance: 100, bodies: [wheel_right, roof]",
        "kind: wind, velocity: [1, 0, 0], temperature: 290, cylinders: [{axis_point: "
        "[0, 0, 0], axis: [0, 0, 1], diameter: 0.1, part: wheel_right}]",
    )
    built = scene((WHEELS, ROOF, DECAL), terms).build()
    wheels, back, upper, inside, contact, wind = built.terms
    assert wheels.named_bodies == (0, 1, 2)
    assert back.named_bodies == (3,)
    assert upper.named_bodies == (0, 1, 2)
    assert inside.named_bodies == (0, 3)
    assert contact.bodies == (1, 3)
    assert [cylinder.body for cylinder in wind.cylinders] == [1]


REST = "{match: '*', ignore: true}"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            {"rules": ("{match: weel, material: copper}", REST)},
            "assembly.parts.0.match: there is no part 'weel'; there are wheel_left, "
            "wheel_right, wheel_small, roof, decal",
        ),
        (
            {"rules": ("{match: [], material: copper}", REST)},
            "assembly.parts.0.match: must not be empty",
        ),
        (
            {"rules": ("{match: '', material: copper}", REST)},
            "assembly.parts.0.match.0: must not be empty",
        ),
        (
            {"rules": (WHEELS, ROOF)},
            "assembly.parts: no rule is for decal: give one, or '*' for all others",
        ),
        (
            {"rules": (WHEELS, "{match: wheel_left, material: brick}", REST)},
            "assembly.parts.1.match: earlier rules match all of its parts: move it up, "
            "or remove it",
        ),
        (
            {"rules": (WHEELS, "{match: decal, ignore: true, pitch: 1}", REST)},
            "assembly.parts.1.pitch: parts that are ignored have no such key: remove "
            "it or `ignore`",
        ),
        (
            {"rules": ("{match: '*', materiel: copper}",)},
            "assembly.parts.0.materiel: unknown key; did you mean 'material'?",
        ),
        (
            {"rules": ("{match: roof}", REST)},
            "assembly.parts.0.material: missing, and it has no default",
        ),
        (
            {"rules": (WHEELS, REST), "assembly": "pitch: 4 cm"},
            "assembly.temperature: missing, and it has no default",
        ),
        (
            {"rules": (WHEELS, REST), "assembly": "temperature: 300"},
            "assembly.parts.0: missing `pitch` or `voxels_high` or `sheet` or "
            "`shape.layers`: give one of them",
        ),
        (
            {"rules": (WHEELS, REST), "terms": (f"{CONVECTION}, on: {{part: roof}}",)},
            "terms.0.on.part: no body has the name 'roof'; there are wheel_left, "
            "wheel_right, wheel_small",
        ),
        (
            {
                "rules": (WHEELS, REST),
                "terms": (
                    f"{CONVECTION}, on: {{side: {{normal: x, body: wheel_left}}}}",
                ),
            },
            "terms.0.on.side.body: expected a number; give a name by `part: "
            "wheel_left`",
        ),
        (
            {
                "rules": (WHEELS, REST),
                "terms": ("kind: contact, conductance: 1, bodies: ['wheel*', 0]",),
            },
            "terms.0.bodies.0: 'wheel*' is the name of 3 bodies: name one",
        ),
        (
            {
                "rules": (WHEELS, REST),
                "bodies": (
                    "{name: wheel_left, solid: cart.glb, pitch: 1, material: brick, "
                    "temperature: 300}",
                ),
            },
            "bodies.1.name: 'wheel_left' is the name of body 0 too: change one",
        ),
        (
            {
                "rules": (
                    "{match: 'wheel*', material: copper, coatings: "
                    "[{emissivity: 1, on: {part: roof}}]}",
                    REST,
                )
            },
            "assembly.parts.0.coatings.0.on.part: only the terms of a scene select "
            "bodies by name: leave it out",
        ),
    ],
)
def test_mistakes_are_one_line(refused, arguments, line):
    assert refused(**arguments) == [line]


def test_nodes_in_a_circle_and_parts_without_extent_are_refused(scene, tmp_path):
    writer = cart()
    document = writer.document
    # The node of the wheels becomes its own grandchild.
    axle = [node.get("name") for node in document["nodes"]].index("axle")
    document["nodes"][0]["children"] = [axle]
    document["scenes"] = [{"nodes": [axle]}]
    (tmp_path / "cart.glb").write_bytes(writer.glb())
    with pytest.raises(InputError, match="is reached twice: nodes are no tree"):
        scene((WHEELS, ROOF, DECAL))
    writer = cart()
    line = writer.accessor([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    faces = writer.accessor([0, 1, 2], "u2")
    flat = writer.mesh({"attributes": {"POSITION": line}, "indices": faces})
    writer.node(name="wire", mesh=flat)
    (tmp_path / "cart.glb").write_bytes(writer.glb())
    with pytest.raises(InputError) as caught:
        scene(("{match: wire, material: copper}", REST))
    assert str(caught.value).endswith(
        "assembly.mesh: the part 'wire/mesh2/-' has no extent: leave it out by {match: "
        "'wire', ignore: true}"
    )
    assert len(scene((WHEELS, "{match: '*', ignore: true}")).bodies) == 3


def test_a_mistake_of_a_body_that_is_built_has_its_place(scene):
    config = scene(("{match: 'wheel*', material: copper, pitch: 1 m}", REST))
    with pytest.raises(InputError, match=r"^bodies\.0 \(wheel_left\): pitch 1 m is"):
        config.build()


def test_the_start_of_a_scene_runs_with_a_temperature(tmp_path, capsys):
    from jaxthermo.__main__ import main

    path = write_cart(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        main(["parts", str(path), "--scene"])
    assert stopped.value.code == 0
    file = tmp_path / "start.yaml"
    file.write_text(capsys.readouterr().out)
    with pytest.raises(InputError) as caught:
        load_config(file)
    assert str(caught.value).endswith(
        "assembly.temperature: missing, and it has no default"
    )
    config = load_config(file, ["assembly.temperature=20 degC"])
    assert [body.name for body in config.bodies] == NAMES
    assert len(config.build().bodies) == 5


def test_the_parts_command_counts_instances(tmp_path, capsys):
    from jaxthermo.__main__ import main

    with pytest.raises(SystemExit):
        main(["parts", str(write_cart(tmp_path)), "--json"])
    parts = json.loads(capsys.readouterr().out)["parts"]
    assert [part["instances"] for part in parts] == [2, 2, 1, 2, 2]

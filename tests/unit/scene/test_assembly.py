"""Bodies from parts by rules in Python."""

import pytest

import jaxthermo as jt
from jaxthermo.errors import InputError


BOX = jt.shapes.box((0.04, 0.04, 0.02))
PARTS = {
    "wheel_left/wheel/rubber": BOX,
    "wheel_right/wheel/rubber": BOX.moved((0.0, 1.0, 0.0)),
    "roof/roof/steel": jt.shapes.rectangle(0.1, 0.1),
    "decal/decal/-": jt.shapes.rectangle(0.01, 0.01),
}
BRICK = jt.materials["brick"]
COPPER = jt.materials["copper"]


def solid(mesh: jt.Mesh) -> jt.FullVolume:
    return jt.FullVolume(jt.voxelize(mesh, pitch=0.02))


def wall(mesh: jt.Mesh) -> jt.Sheet:
    return jt.Sheet(mesh, (jt.Layer(COPPER, 1e-3),), pitch=0.05, cells=1)


RULES = [
    jt.Rule("wheel_right", solid, material=COPPER, temperature=350.0),
    jt.Rule(["rubber"], solid, material=BRICK),
    jt.Rule("roof", wall, coatings=(jt.Coating(emissivity=0.5),)),
    jt.Rule("*"),
]


def test_the_first_rule_that_matches_counts():
    left, right, roof = jt.assembly(PARTS, RULES, temperature=300.0)
    assert [body.name for body in (left, right, roof)] == [
        "wheel_left",
        "wheel_right",
        "roof",
    ]
    assert (left.material, right.material, roof.material) == (BRICK, COPPER, None)
    assert (left.temperature, right.temperature) == (300.0, 350.0)
    assert right.pose == jt.Pose((0.0, 1.0, 0.0))
    assert isinstance(roof.structure, jt.Sheet)
    assert roof.coatings[0].emissivity == 0.5


def test_equal_parts_of_a_rule_share_one_structure():
    calls = []

    def counted(mesh: jt.Mesh) -> jt.FullVolume:
        calls.append(mesh.name)
        return solid(mesh)

    copies = {f"part {n}": BOX.moved((0.1 * n, 0.0, 0.0)) for n in range(50)}
    rules = [jt.Rule("*", counted, material=BRICK)]
    bodies = jt.assembly(copies, rules, temperature=300.0)
    assert len(bodies) == 50
    assert len(calls) == len({id(body.structure) for body in bodies}) == 1


@pytest.mark.parametrize(
    ("rules", "line"),
    [
        ([jt.Rule("*", wall), jt.Rule("rof")], "rules[1]=): there is no part 'rof'"),
        ([jt.Rule("roof", wall)], "rules=): no rule is for wheel_left, wheel_right"),
        ([jt.Rule("*"), jt.Rule("roof")], "rules[1]=): earlier rules match all"),
        ([jt.Rule("*", wall)], "temperature=): missing, and rules[0] has none"),
    ],
)
def test_mistakes_are_one_line(rules, line):
    with pytest.raises(InputError) as caught:
        jt.assembly(PARTS, rules)
    assert str(caught.value).startswith(f"assembly({line}")
    assert "\n" not in str(caught.value)

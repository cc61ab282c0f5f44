"""Joints by the names of bodies: which rule counts, what is told, what is refused."""

import functools

import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.alike_lines import grouped_lines
from jaxthermo.errors import InputError
from jaxthermo.scene.compile.compile import compile_scene
from tests.sheet_bodies import plate


@functools.cache
def cube():
    return jt.FullVolume(jt.voxelize(jt.shapes.box((0.02, 0.02, 0.02)), 0.01))


@functools.cache
def strip():
    return jt.Sheet(plate(0.02, 0.02), (jt.Layer("copper", 1e-3),), pitch=0.01)


def row(count=3, distance=0.02, sheets=0):
    """Cubes in a row, "a", "b", .., and sheets in a line of their own, "s0", .."""
    solids = [
        jt.Body(
            cube(),
            jt.materials["copper"],
            temperature=300.0,
            pose=jt.Pose((distance * n, 0.0, 0.0)),
            name="abcdefgh"[n],
        )
        for n in range(count)
    ]
    walls = [
        jt.Body(
            strip(), temperature=300.0, pose=jt.Pose((0.02 * n, 1.0, 0.0)), name=f"s{n}"
        )
        for n in range(sheets)
    ]
    return (*solids, *walls)


def compiled(bodies, terms):
    return compile_scene(jt.Scene(bodies, tuple(terms)))


def joined(result):
    return {entry for entry in result.program.entries if len(entry[1]) == 2}


def test_the_first_rule_that_matches_counts():
    bodies = row(sheets=2)
    pairs = {("a", "b"): 500.0, ("s*", "s*"): 2000.0}
    terms = jt.joints(bodies, pairs, default=float("inf"))
    assert [type(term) for term in terms] == 3 * [jt.Contact, jt.Seam]
    result = compiled(bodies, terms)
    assert joined(result) == {
        ("contact", (0, 1)),
        ("contact#3", (1, 2)),
        ("seam#2", (3, 4)),
    }
    notes = [line for line in result.receipt.notes if "conduct" in line]
    assert notes == [
        "contact: bodies 0 (a) and 1 (b) conduct through 0.0004 m2, with 500 W/(m2 K)",
        "seam#2: bodies 3 (s0) and 4 (s1) conduct along 0.02 m, with 2000 W/(m2 K)",
        "contact#3: bodies 1 (b) and 2 (c) conduct through 0.0004 m2, bonded",
    ]


def test_a_conductance_of_0_takes_two_bodies_out_of_the_default():
    bodies = row()
    result = compiled(bodies, jt.joints(bodies, {("a", "b"): 0.0}, default=100.0))
    assert joined(result) == {("contact#2", (1, 2))}


def test_solids_alone_have_no_seams():
    assert len(jt.joints(row(), default=100.0)) == 1
    assert jt.joints(row()) == ()


def test_a_joint_of_bodies_that_are_apart_is_refused():
    bodies = row()
    with pytest.raises(
        InputError, match=r"body 0 \(a\) and body 2 \(c\) are apart: move .*`threshold`"
    ):
        compiled(bodies, jt.joints(bodies, {("a", "c"): 100.0}))
    # One of a rule's bodies may be apart from the others.
    result = compiled(bodies, jt.joints(bodies, {("a", "*"): 1.0}))
    assert joined(result) == {("contact", (0, 1))}
    # A rule for all has no pair that must touch.
    apart = row(distance=0.05)
    assert not joined(compiled(apart, jt.joints(apart, default=100.0)))
    # A seam joins what no faces do.
    walls = row(count=0, sheets=2)
    result = compiled(walls, jt.joints(walls, {("s0", "s1"): 100.0}))
    assert joined(result) == {("seam", (0, 1))}


def test_a_joint_that_an_earlier_one_hides_is_refused():
    bodies = row()
    for earlier, later in (
        (None, None),
        ((0, 1), (1, 0)),
        (None, (0, 1)),
        (((0, 1), (1, 2)), (1, 2)),
    ):
        terms = (jt.Contact(1.0, bodies=earlier), jt.Contact(2.0, bodies=later))
        with pytest.raises(InputError, match="both join bodies .* the fewer first"):
            compiled(bodies, terms)


def test_wrong_names_and_bodies_are_refused():
    bodies = row()
    with pytest.raises(InputError, match="no body has the name 'x'; there are a, b, c"):
        jt.joints(bodies, {("a", "x"): 1.0})
    with pytest.raises(InputError, match="name two bodies"):
        jt.joints(bodies, {("a", "a"): 1.0})
    with pytest.raises(InputError, match=r"Seam\(threshold=-1.*positive length"):
        jt.Seam(1.0, threshold=-1.0)


def test_many_joints_are_one_line():
    bodies = row(count=8)
    result = compiled(bodies, jt.joints(bodies, default=100.0))
    lines = [line for line in grouped_lines(result.receipt.notes) if "conduct" in line]
    assert len(lines) == 1
    assert "and 6 more like it" in lines[0]


def test_bodies_in_one_network_conduct_as_each_by_itself():
    """Cubes that are joined in one network; chains of equal conductances."""
    bodies = tuple(
        jt.Body(
            body.structure,
            body.material,
            temperature=300.0 + 10.0 * n,
            pose=body.pose,
            name=body.name,
        )
        for n, body in enumerate(row(count=4, sheets=0))
    )
    scene = jt.Scene(bodies, jt.joints(bodies, default=100.0), dtype="float64")
    solution = jt.simulate(scene, 60.0, solver=jt.ForwardEuler(dt=0.05))
    implicit = jt.simulate(scene, 60.0, solver=jt.TRBDF2(dt=2.0))
    assert_allclose(solution.mean_temperature, implicit.mean_temperature, atol=0.02)
    assert solution.mean_temperature.sum() == pytest.approx(1260.0, abs=1e-9)

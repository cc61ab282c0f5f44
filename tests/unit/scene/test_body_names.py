"""Names of bodies: in receipts, errors, frames and files; many in few lines."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxthermo as jt
from calibrate.problem.parameters import find_path
from jaxthermo.alike_lines import grouped_lines
from jaxthermo.cli.body_lines import ReceiptRow, body_lines, summed
from jaxthermo.cli.summary import write_energy
from jaxthermo.errors import InputError
from jaxthermo.image.files.exr import read_exr
from jaxthermo.integrate.ledger import pair_name
from jaxthermo.integrate.run.solution_file import load_solution
from jaxthermo.scene.compile.body_names import (
    named_receipt,
    naming_bodies,
)


GRID = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.02)
STRUCTURE = jt.FullVolume(GRID)


def cube(name: str, x: float = 0.0, **options) -> jt.Body:
    return jt.Body(
        STRUCTURE,
        jt.materials["brick"],
        temperature=300.0,
        pose=jt.Pose((x, 0.0, 0.0)),
        name=name,
        **options,
    )


@pytest.fixture(scope="module")
def scene() -> jt.Scene:
    on = jt.Everything(body=1)
    terms = (jt.Convection(10.0, 290.0, on=on), jt.Contact(100.0))
    return jt.Scene((cube("door.left"), cube("", 0.04)), terms)


@pytest.fixture(scope="module")
def solution(scene) -> jt.Solution:
    return jt.simulate(scene, t1=10.0)


def test_receipts_name_bodies(solution):
    receipt = solution.receipt
    assert receipt.body_names == ("door.left", "")
    assert receipt.as_dict()["body_names"] == ("door.left", "")
    left_out = {omission.what for omission in receipt.left_out}
    assert "per-node conductivity on body 0 (door.left)" in left_out
    assert "per-node conductivity on body 1" in left_out


def test_frames_and_files_have_the_names(solution, tmp_path):
    solution.save(tmp_path)
    stored = load_solution(tmp_path / "solution.npz")
    assert [s.geometry.name for s in stored.surfaces] == ["door.left", ""]
    camera = jt.Camera((0.1, -0.5, 0.0), (0.1, 0.0, 0.0), width=32, height=24)
    image = jt.render(solution, camera)
    assert image.body_names == ("door.left", "")
    jt.write_exr(tmp_path / "frame.exr", image)
    _, header = read_exr(tmp_path / "frame.exr")
    assert json.loads(header["bodies"]) == {"0": "door.left", "1": ""}


def test_temperatures_are_found_by_name(solution):
    by_name = solution.of_body("door.left")
    np.testing.assert_array_equal(by_name, solution.of_body(0))
    count = len(GRID.fragment_area)
    np.testing.assert_array_equal(by_name, solution.surface_temperature[:, :count])
    with pytest.raises(InputError, match=r"no body has the name 'roof'; .*door\.left"):
        solution.of_body("roof")
    with pytest.raises(InputError, match="there is no body 7; there are 2: count from"):
        solution.of_body(7)


def test_heat_through_a_contact_has_the_names(scene, solution, tmp_path):
    pair = "contact 0 (door.left)-1"
    for balance in (solution.energy, jt.steady(scene).heat_rates):
        assert [*balance.contacts] == [pair]
        assert [*balance.bodies[1].contacts] == [pair]
    write_energy(tmp_path / "energy.csv", scene, solution)
    header, _ = (tmp_path / "energy.csv").read_text().split("\n", 1)
    columns = [column for column in header.split(",") if "contact" in column]
    labels = ["", "body 0 (door.left): ", "body 1: "]
    assert columns == [f"{label}{pair}_J" for label in labels]


def test_pairs_whose_names_read_alike_stay_apart():
    names = ("a", "a-b", "b-c", "c")
    pairs = [pair_name("contact", bodies, names) for bodies in ((0, 2), (1, 3))]
    assert pairs == ["contact 0 (a)-2 (b-c)", "contact 1 (a-b)-3 (c)"]
    assert pair_name("seam", (0, 1), ("", "")) == "seam 0-1"


def test_warnings_name_bodies(scene, solution):
    lines = ("bodies 0 and 1 overlap by 3 mm, 5 % of body 0",)
    receipt = named_receipt(replace(solution.receipt, warnings=lines), scene)
    assert receipt.warnings == (
        "bodies 0 (door.left) and 1 overlap by 3 mm, 5 % of body 0 (door.left)",
    )


def test_errors_name_bodies():
    selection = jt.Face("back", body=1)
    scene = jt.Scene((cube("a"), cube("b", 1.0)), (jt.HeatFlux(1.0, on=selection),))
    with pytest.raises(InputError, match=r"body 1 \(b\) is solid"):
        jt.compile_scene(scene)


def test_two_bodies_of_one_name_are_refused():
    with pytest.raises(InputError, match=r"the bodies \[0, 2\] have the name 'a'"):
        jt.Scene((cube("a"), cube("b", 1.0), cube("a", 2.0)))


def test_parameters_are_found_by_names_with_dots(scene):
    path = find_path(scene, "bodies.door.left.material.conductivity")
    assert path == ("bodies", 0, "material", "conductivity")
    assert find_path(scene, "bodies.1.temperature") == ("bodies", 1, "temperature")
    with pytest.raises(InputError, match="bodies has no 'window'"):
        find_path(scene, "bodies.window.temperature")


# One that has its name, one without, one that is not there.
MENTIONS = {
    "body 0 and body 2": "body 0 (a) and body 2 (c)",
    "body 0 (a), body 1": "body 0 (a), body 1",
    "bodies[2]: body 12": "bodies[2] (c): body 12",
    "bodies[2] (c): no": "bodies[2] (c): no",
    "bodies 0 and 2 overlap": "bodies 0 (a) and 2 (c) overlap",
    "bodies 0 (a) and 2 (c) overlap": "bodies 0 (a) and 2 (c) overlap",
}


@pytest.mark.parametrize("line", MENTIONS)
def test_only_whole_mentions_are_named(line):
    @naming_bodies
    def refuse(scene):
        raise InputError(line)

    with pytest.raises(InputError) as error:
        refuse(jt.Scene((cube("a"), cube("", 0.2), cube("c", 0.4))))
    assert str(error.value) == MENTIONS[line]


def test_many_lines_that_differ_in_bodies_are_one():
    lines = [f"body {n} (part {n}) is off by {n + 0.5} %" for n in range(200)]
    assert grouped_lines(lines) == [f"{lines[0]} - and 199 more like it"]
    assert grouped_lines(lines[:3]) == lines[:3]
    sections = [f"body {n} has a section across {'xyz'[n % 3]}" for n in range(6)]
    assert grouped_lines(sections) == [f"{sections[0]} - and 5 more like it"]


def test_200_bodies_are_few_lines():
    bodies = tuple(cube(f"part {n}", float(n)) for n in range(200))
    # 40 kinds, of which twenty have more bodies than the others.
    kinds = [n % 40 if n < 180 else n % 20 for n in range(200)]
    descriptions = [["mesh", f"{kind} voxels", "1 kg"] for kind in kinds]
    lines = body_lines(jt.Scene(bodies), descriptions)
    assert len(lines) == 22
    assert lines[0] == "200 bodies of 40 kinds:"
    assert lines[1].startswith("  6 bodies (body 0 (part 0), body 40 (part 40), ")
    assert lines[1].endswith("..): 0 voxels; 1 kg")
    told = sum(int(line.split()[0]) for line in lines[1:-1])
    assert lines[-1] == f"  and {200 - told} more of 20 other kinds"
    few = body_lines(jt.Scene(bodies[:2]), descriptions[:2])
    assert few[0] == "body 0 (part 0): mesh"
    assert len(few) == 6


def test_rows_of_a_mechanism_are_summed():
    rows = [
        ReceiptRow("sun", f"body {n}", area=2.0, share=0.5, volume=0.0, heat_rate=3.0)
        for n in range(10)
    ]
    (row,) = summed(rows)
    assert row.cells == (
        "sun",
        "10 bodies (body 0, body 1, body 2, ..)",
        "20 m2",
        "",
        "",
        "30 W",
    )


def test_rows_of_a_joint_are_of_pairs():
    rows = [
        ReceiptRow(
            "contact",
            f"body {n} and body {n + 1}",
            area=1.0,
            share=0.5,
            volume=0.0,
            heat_rate=0.0,
            is_of_pair=True,
        )
        for n in range(10)
    ]
    (row,) = summed(rows)
    assert row.where.startswith("10 pairs (body 0 and body 1, body 1 and body 2, ")


def test_names_are_no_leaves_of_a_scene(scene):
    leaves = jax.tree.leaves(scene)
    assert not any(isinstance(leaf, str) for leaf in leaves)
    assert np.asarray(scene.bodies[0].temperature) == 300.0

"""Damaged mesh files end in one line, or in a mesh that is right or says it is not.

A mesh says so by its open edges and its repairs. What files have no check for is left
whole: coordinates that several triangles share, where another number is another mesh.
"""

import re
import struct
from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from jaxthermo.errors import InputError
from jaxthermo.geometry.load import load_mesh
from tests.mesh_files import (
    GIVEN,
    GltfWriter,
    draco_primitive,
    exported,
    polygon_file,
)


Random = np.random.Generator
BALL = trimesh.creation.icosphere(subdivisions=1)
AREA = float(BALL.area)
EXTENT = np.ptp(BALL.bounds, axis=0)
TOLERANCE = 0.01


def glb(compressed: bool = False) -> bytes:
    writer = GltfWriter()
    if compressed:
        primitive = draco_primitive(writer, BALL.vertices, BALL.faces)
    else:
        position = writer.accessor(BALL.vertices)
        indices = writer.accessor(BALL.faces.reshape(-1), "u2")
        primitive = {"attributes": {"POSITION": position}, "indices": indices}
    writer.node(mesh=writer.mesh(primitive))
    return writer.glb()


FILES: dict[str, bytes] = {
    "ball.stl": exported(BALL, "stl"),
    "text.stl": exported(BALL, "stl_ascii"),
    "ball.glb": glb(),
    "draco.glb": glb(compressed=True),
    "ball.3mf": exported(trimesh.Scene(BALL), "3mf"),
    "text.ply": polygon_file("ply", BALL.vertices, BALL.faces.tolist()),
    "little.ply": polygon_file("ply_little", BALL.vertices, BALL.faces.tolist()),
    "ball.off": polygon_file("off", BALL.vertices, BALL.faces.tolist()),
    "ball.obj": polygon_file("obj", BALL.vertices, BALL.faces.tolist()),
}


def coordinates(name: str) -> range:
    """Places of the bytes of the coordinates, if damage to them is another mesh."""
    content = FILES[name]
    if name == "ball.glb":
        start = content.index(b"BIN\0") + len(b"BIN\0")
        return range(start, start + BALL.vertices.astype(np.float32).nbytes)
    if name == "ball.obj":
        return range(content.index(b"f "))
    if name == "ball.off":
        return range(content.index(b" 0\n"), content.index(b"\n3 "))
    start = content.find(b"end_header\n") + len(b"end_header\n")
    if name == "text.ply":
        return range(start, content.index(b"\n3 ", start))
    return (
        range(start, start + BALL.vertices.nbytes) if name == "little.ply" else range(0)
    )


def cut(name: str, random: Random) -> bytes:
    content = FILES[name]
    return content[: random.integers(1, len(content))]


def swap(name: str, random: Random) -> bytes:
    """Two neighbouring bytes, that differ, in the other order."""
    content = bytearray(FILES[name])
    untouched = coordinates(name)
    while True:
        place = int(random.integers(len(content) - 1))
        if place not in untouched and content[place] != content[place + 1]:
            content[place : place + 2] = content[place : place + 2][::-1]
            return bytes(content)


def reverse_words(name: str, random: Random) -> bytes:
    """Groups of four bytes in the order of another processor, from some place on."""
    content = FILES[name]
    first = max(coordinates(name).stop, 80) // 4
    place = 4 * int(random.integers(first, len(content) // 4 - 1))
    words = np.frombuffer(content[place : len(content) // 4 * 4], "<u4")
    return content[:place] + words.astype(">u4").tobytes()


def wrong_count(name: str, random: Random) -> bytes:
    """A number of vertices, faces or bytes that is too large or too small."""
    content = FILES[name]
    change = int(random.choice([-7, -2, -1, 1, 2, 9, 10**6]))
    if name == "ball.stl":
        count = len(BALL.faces) + change
        return content[:80] + struct.pack("<I", count) + content[84:]
    patterns = {
        "off": rb"(?<=OFF\n)\d+|(?<=OFF\n42 )\d+",
        "ply": rb"(?<=element vertex )\d+|(?<=element face )\d+",
        "glb": rb'(?<="count": )\d+|(?<="byteLength": )\d+|(?<="byteOffset": )\d+',
    }
    matches = list(re.finditer(patterns[name.split(".")[1]], content))
    match = matches[random.integers(len(matches))]
    number = b"%d" % max(int(match[0]) + change, 0)
    if name.endswith("glb"):
        # As long as before, so that only the number is wrong.
        number = number.ljust(len(match[0]))[: len(match[0])]
    return content[: match.start()] + number + content[match.end() :]


def other_extension(name: str, random: Random) -> bytes:
    """An entry or extension of the JSON by another name of the same length."""
    content = FILES[name]
    names = list(re.finditer(rb'"[A-Za-z_]{5,}"', content))
    start, end = names[random.integers(len(names))].span()
    letters = bytearray(content[start + 1 : end - 1])
    place = int(random.integers(len(letters) - 1))
    letters[place : place + 2] = letters[place : place + 2][::-1]
    return content[: start + 1] + bytes(letters) + content[end - 1 :]


Damage = Callable[[str, Random], bytes]
DAMAGES: list[tuple[Damage, str, int]] = [
    *((cut, name, 4) for name in FILES),
    *((swap, name, 6) for name in FILES),
    *((reverse_words, name, 3) for name in ("ball.stl", "little.ply", "ball.glb")),
    *((wrong_count, name, 5) for name in ("ball.stl", "ball.off", "text.ply")),
    *((wrong_count, name, 5) for name in ("little.ply", "ball.glb", "draco.glb")),
    *((other_extension, name, 8) for name in ("ball.glb", "draco.glb")),
]
CASES = [
    pytest.param(damage, name, seed, id=f"{damage.__name__}-{name}-{seed}")
    for damage, name, count in DAMAGES
    for seed in range(count)
]


def test_there_are_as_many_as_promised():
    assert len(CASES) >= 120


@pytest.mark.parametrize("name", FILES)
def test_whole_files_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    assert is_right(load_mesh(tmp_path / name, unit="m"))


def is_right(mesh) -> bool:
    extent = np.ptp(mesh.bounds, axis=0)
    return mesh.area == pytest.approx(AREA, rel=TOLERANCE) and (
        extent == pytest.approx(EXTENT, rel=TOLERANCE)
    )


@pytest.mark.parametrize(("damage", "name", "seed"), CASES)
def test_no_damage_is_silent(tmp_path, capfd, damage, name, seed):
    random = np.random.default_rng(seed)
    path = tmp_path / name
    path.write_bytes(damage(name, random))
    assert path.read_bytes() != FILES[name]
    try:
        mesh = load_mesh(path, unit="m")
    except InputError as error:
        assert str(error).startswith(str(path))
        assert "\n" not in str(error)
        # Our own checks of types would not be there for a user.
        assert "Type-check" not in str(error)
    else:
        repairs = set(mesh.repairs) - {"merged_vertices", "unused_vertices"}
        assert is_right(mesh) or not mesh.is_watertight or repairs
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("seed", range(12))
def test_given_files_cut_anywhere(tmp_path, seed):
    """Those whose surfaces are closed are refused, or open."""
    random = np.random.default_rng(seed)
    for given in sorted(GIVEN.glob("*.glb")):
        content = given.read_bytes()
        path = tmp_path / given.name
        path.write_bytes(content[: random.integers(1, len(content))])
        with pytest.raises(InputError, match=re.escape(str(path))):
            load_mesh(path, unit="m")

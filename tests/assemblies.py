"""A small glTF of several nodes: wheels that are copies, a roof and a decal."""

from pathlib import Path

from tests.mesh_files import GltfWriter, box_primitive


QUARTER = [0.0, 0.0, 0.7071067811865476, 0.7071067811865476]
"""Quaternion of a quarter of a turn about z."""

NAMES = ["wheel_left", "wheel_right", "wheel_small", "roof", "decal"]


def cart() -> GltfWriter:
    """A cart in metres with z up; its wheels are below a node that is moved."""
    writer = GltfWriter()
    box = writer.mesh(box_primitive(writer, (0.2, 0.04, 0.2)), name="wheel")
    sheet = writer.accessor([[0, 0, 1], [1, 0, 1], [1, 0.4, 1], [0, 0.4, 1]])
    faces = writer.accessor([0, 1, 2, 0, 2, 3], "u2")
    flat = writer.mesh({"attributes": {"POSITION": sheet}, "indices": faces})
    wheels = [
        writer.node(name="wheel_left", mesh=box, translation=[0.0, 0.5, 0.0]),
        writer.node(name="wheel_right", mesh=box, rotation=QUARTER),
        writer.node(name="wheel_small", mesh=box, scale=[0.5, 0.5, 0.5]),
    ]
    writer.node(name="axle", children=wheels, translation=[1.0, 0.0, 0.0])
    writer.node(name="roof", mesh=flat)
    writer.node(name="decal", mesh=flat, translation=[0.0, 0.0, 0.01])
    return writer


def write_cart(folder: Path) -> Path:
    """The path of the cart as cart.glb."""
    path = folder / "cart.glb"
    path.write_bytes(cart().glb())
    return path

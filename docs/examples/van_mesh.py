"""A panel van of 60 named nodes, written as van.glb.

python docs/examples/van_mesh.py [--out van.glb]

Body panels, windows and lining are open surfaces, for sheets; tyres, rims, the engine
and the like are closed, for solids. The four wheels are instances of one. Materials
have the names of `jaxthermo materials`. `jaxthermo parts van.glb --up y` lists them.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

import jaxthermo as jt


# Lengths in metres; x is ahead, y to the left, z up, and the van stands on z = 0.
HALF_WIDTH = 0.98
SILL = 0.38
ARCH = 0.78
BELT = 1.42
HEADER = 2.05
ROOF = 2.38
REAR = -2.5
PILLAR = 0.35
NOSE = 2.5
COWL = 1.75
ROOF_EDGE = 1.0
BONNET_EDGE = 1.05
REAR_AXLE = -1.6
FRONT_AXLE = 1.7
TYRE = 0.33

WHEELS = {
    f"{end}_{side}": (axle, sign * 0.86, TYRE)
    for end, axle in (("front", FRONT_AXLE), ("rear", REAR_AXLE))
    for side, sign in (("left", 1.0), ("right", -1.0))
}

# Files have y up: x, z and -y of the van.
Y_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)
COLOURS = {
    "steel": [225, 225, 228, 255],
    "car_glass": [90, 110, 115, 255],
    "tyre_rubber": [30, 30, 30, 255],
    "aluminium": [170, 172, 175, 255],
    "cast_iron": [80, 76, 72, 255],
    "polypropylene": [55, 55, 58, 255],
    "polyurethane_foam": [75, 80, 95, 255],
    "plywood": [165, 130, 90, 255],
}


Point = tuple[float, float, float]


class Part(NamedTuple):
    """A node of the file: its name, its mesh and the position of that."""

    node: str
    mesh: jt.Mesh
    material: str
    translation: Point = (0.0, 0.0, 0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("van.glb"))
    options = parser.parse_args()
    parts = [*panels(), *windows(), *trim(), *interior(), *machinery(), *wheels()]
    write_glb(options.out, parts)
    area = sum(part.mesh.area for part in parts if not part.mesh.is_watertight)
    print(f"{options.out}: {len(parts)} nodes, {area:.1f} m^2 of open surfaces")


def write_glb(path: Path, parts: list[Part]) -> None:
    """Write each mesh once, with a node for each part that has it."""
    scene = trimesh.Scene()
    for part in parts:
        # A mesh of several nodes is added with the first of them.
        if part.mesh.name not in scene.geometry:
            material = PBRMaterial(
                name=part.material, baseColorFactor=COLOURS[part.material]
            )
            visual = TextureVisuals(material=material)
            triangles = trimesh.Trimesh(
                part.mesh.vertices, part.mesh.faces, visual=visual, process=False
            )
            scene.geometry[part.mesh.name] = triangles
        moved = np.eye(4)
        moved[:3, 3] = part.translation
        scene.graph.update(part.node, matrix=Y_UP @ moved, geometry=part.mesh.name)
    scene.export(path, file_type="glb")


def named(name: str, mesh: jt.Mesh) -> jt.Mesh:
    return jt.Mesh(vertices=mesh.vertices, faces=mesh.faces, name=name)


def panel(name: str, material: str, points: list[Point], front: Point) -> Part:
    """A flat panel; its front is on the side of the direction."""
    mesh = jt.shapes.polygon(points)
    if mesh.area_vectors.sum(axis=0) @ np.array(front) < 0.0:
        mesh = jt.shapes.polygon(points[::-1])
    return Part(name, named(name, mesh), material)


def both_sides(
    name: str, material: str, outline: list[tuple[float, float]], y: float = HALF_WIDTH
) -> Iterator[Part]:
    """A panel with corners [x, z] of the left side, and its mirror image."""
    for side, sign in (("left", 1.0), ("right", -1.0)):
        points = [(x, sign * y, z) for x, z in outline]
        yield panel(f"{name}_{side}", material, points, front=(0.0, sign, 0.0))


def across(
    name: str,
    material: str,
    edges: tuple[tuple[float, float], tuple[float, float]],
    y: tuple[float, float] = (-HALF_WIDTH, HALF_WIDTH),
    *,
    front: Point,
) -> Part:
    """A panel between two edges across the van, each at its [x, z]."""
    (x0, z0), (x1, z1) = edges
    points = [(x0, y[0], z0), (x0, y[1], z0), (x1, y[1], z1), (x1, y[0], z1)]
    return panel(name, material, points, front)


def block(name: str, material: str, size: Point, centre: Point) -> Part:
    return Part(name, named(name, jt.shapes.box(size)), material, centre)


def about_y(mesh: jt.Mesh, quarters: int) -> jt.Mesh:
    """A shape turned about y by quarters of a turn: one turns z to x."""
    return mesh.placed(jt.Pose.about((0.0, 1.0, 0.0), quarters * np.pi / 2))


def along_y(mesh: jt.Mesh) -> jt.Mesh:
    """A shape about z, turned to be about y."""
    return mesh.placed(jt.Pose.about((1.0, 0.0, 0.0), np.pi / 2))


def panels() -> Iterator[Part]:
    """Steel sheet outside."""
    up = (0.0, 0.0, 1.0)
    down = (0.0, 0.0, -1.0)
    ahead = (1.0, 0.0, 0.0)
    behind = (-1.0, 0.0, 0.0)
    yield across("roof", "steel", ((REAR, ROOF), (ROOF_EDGE, ROOF)), front=up)
    yield across("bonnet", "steel", ((COWL, BELT), (NOSE, BONNET_EDGE)), front=up)
    yield across("nose", "steel", ((NOSE, 0.7), (NOSE, BONNET_EDGE)), front=ahead)
    yield across("floor", "steel", ((REAR, ARCH), (COWL, ARCH)), front=down)
    tray = ((REAR_AXLE + 0.4, SILL), (FRONT_AXLE - 0.4, SILL))
    yield across("undertray", "steel", tray, front=down)
    yield across("bulkhead", "steel", ((PILLAR, ARCH), (PILLAR, ROOF)), front=ahead)
    yield across("firewall", "steel", ((COWL, ARCH), (COWL, BELT)), front=ahead)
    for side, y in (("left", (0.0, HALF_WIDTH)), ("right", (-HALF_WIDTH, 0.0))):
        lower = ((REAR, SILL), (REAR, BELT))
        upper = ((REAR, HEADER), (REAR, ROOF))
        yield across(f"rear_door_{side}", "steel", lower, y, front=behind)
        yield across(f"rear_header_{side}", "steel", upper, y, front=behind)
    # Between the wheels down to the sill, above them to their arches.
    rear_arch = REAR_AXLE + 0.4
    front_arch = FRONT_AXLE - 0.4
    sill = [
        (rear_arch, SILL),
        (front_arch, SILL),
        (front_arch, ARCH),
        (rear_arch, ARCH),
    ]
    yield from both_sides("sill", "steel", sill)
    load = [(REAR, ARCH), (PILLAR, ARCH), (PILLAR, ROOF), (REAR, ROOF)]
    yield from both_sides("load_side", "steel", load)
    door = [(PILLAR, ARCH), (COWL, ARCH), (COWL, BELT), (PILLAR, BELT)]
    yield from both_sides("door", "steel", door)
    wing = [(COWL, ARCH), (NOSE, ARCH), (NOSE, BONNET_EDGE), (COWL, BELT)]
    yield from both_sides("wing", "steel", wing)
    header_x = windscreen_x(HEADER)
    header = [(PILLAR, HEADER), (header_x, HEADER), (ROOF_EDGE, ROOF), (PILLAR, ROOF)]
    yield from both_sides("door_header", "steel", header)


def windscreen_x(z: float) -> float:
    """Position of the windscreen at a height."""
    return COWL + (z - BELT) / (ROOF - BELT) * (ROOF_EDGE - COWL)


def windows() -> Iterator[Part]:
    """Panes of glass."""
    ahead = (1.0, 0.0, 0.0)
    slope = ((COWL, BELT), (ROOF_EDGE, ROOF))
    yield across("windscreen", "car_glass", slope, front=ahead)
    top = windscreen_x(HEADER)
    pane = [(PILLAR, BELT), (COWL, BELT), (top, HEADER), (PILLAR, HEADER)]
    yield from both_sides("door_window", "car_glass", pane)
    for side, y in (("left", (0.0, HALF_WIDTH)), ("right", (-HALF_WIDTH, 0.0))):
        pane = ((REAR, BELT), (REAR, HEADER))
        front = (-1.0, 0.0, 0.0)
        yield across(f"rear_window_{side}", "car_glass", pane, y, front=front)
    lamp = named("headlight", about_y(jt.shapes.rectangle(0.16, 0.34), 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        translation = (NOSE + 0.01, sign * 0.7, 0.88)
        yield Part(f"headlight_{side}", lamp, "car_glass", translation)


def trim() -> Iterator[Part]:
    """Plastic parts outside."""
    hollow = jt.shapes.tray((0.3, 1.9, 0.12))
    # The open side of a tray is up; that of a bumper is towards the van.
    for end, x, quarters in (("front", NOSE, -1), ("rear", REAR, 1)):
        bumper = about_y(hollow, quarters)
        name = f"bumper_{end}"
        yield Part(name, named(name, bumper), "polypropylene", (x, 0.0, 0.52))
    mirror = named("mirror", jt.shapes.box((0.12, 0.2, 0.3)))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        translation = (1.5, sign * (HALF_WIDTH + 0.12), 1.6)
        yield Part(f"mirror_{side}", mirror, "polypropylene", translation)


def interior() -> Iterator[Part]:
    """Lining, seats and dashboard."""
    lining = HALF_WIDTH - 0.05
    side = [(REAR + 0.05, 0.8), (PILLAR - 0.05, 0.8)]
    side += [(PILLAR - 0.05, 1.9), (REAR + 0.05, 1.9)]
    yield from both_sides("lining", "plywood", side, y=lining)
    edges = ((REAR + 0.05, 0.8), (PILLAR - 0.05, 0.8))
    width = (-lining, lining)
    up = (0.0, 0.0, 1.0)
    yield across("load_floor", "plywood", edges, width, front=up)
    edges = ((REAR + 0.05, 1.9), (PILLAR - 0.05, 1.9))
    yield across("shelf", "plywood", edges, (0.47, lining), front=up)
    headliner = ((PILLAR + 0.05, ROOF - 0.06), (ROOF_EDGE, ROOF - 0.06))
    down = (0.0, 0.0, -1.0)
    yield across("headliner", "polyurethane_foam", headliner, width, front=down)
    profile = [(0.0, 0.0), (0.3, 0.0), (0.35, 0.25), (0.05, 0.3)]
    dashboard = along_y(jt.shapes.prism(profile, 1.8))
    translation = (1.35, 0.0, 1.08)
    yield Part("dashboard", named("dashboard", dashboard), "polypropylene", translation)
    ring = jt.shapes.tube(0.19, 0.16, 0.03)
    wheel = ring.placed(jt.Pose.about((0.0, 1.0, 0.0), -1.0))
    translation = (1.2, 0.45, 1.35)
    yield Part(
        "steering_wheel", named("steering_wheel", wheel), "polypropylene", translation
    )
    cushion = named("cushion", jt.shapes.box((0.5, 0.5, 0.14)))
    back = named("back_rest", jt.shapes.box((0.14, 0.5, 0.7)))
    for seat, y in (("driver", 0.45), ("passenger", -0.45)):
        foam = "polyurethane_foam"
        yield Part(f"cushion_{seat}", cushion, foam, (0.75, y, 1.05))
        yield Part(f"back_rest_{seat}", back, foam, (0.5, y, 1.45))


def machinery() -> Iterator[Part]:
    """Engine, drive, exhaust and tank."""
    yield block("engine_block", "cast_iron", (0.45, 0.6, 0.5), (2.05, 0.0, 0.75))
    yield block("gearbox", "aluminium", (0.5, 0.35, 0.35), (1.55, 0.0, 0.5))
    yield block("radiator", "aluminium", (0.05, 0.8, 0.45), (2.42, 0.0, 0.75))
    yield block("battery", "polypropylene", (0.18, 0.28, 0.2), (2.1, 0.6, 0.95))
    yield block("fuel_tank", "polypropylene", (0.9, 0.5, 0.25), (0.2, 0.5, 0.55))
    pipe = about_y(jt.shapes.pipe(0.03, 2.6, sections=16), 1)
    translation = (0.0, -0.3, 0.45)
    yield Part("exhaust_pipe", named("exhaust_pipe", pipe), "steel", translation)
    silencer = about_y(jt.shapes.cylinder(0.1, 0.6, sections=24), 1)
    translation = (-1.6, -0.3, 0.45)
    yield Part("silencer", named("silencer", silencer), "steel", translation)
    axle = along_y(jt.shapes.cylinder(0.04, 1.5, sections=16))
    for end, x in (("front", FRONT_AXLE), ("rear", REAR_AXLE)):
        yield Part(f"axle_{end}", named("axle", axle), "steel", (x, 0.0, TYRE))


def wheels() -> Iterator[Part]:
    """Four instances of a tyre and of a rim."""
    tyre = named("tyre", along_y(jt.shapes.tube(TYRE, 0.2, 0.2, sections=32)))
    rim = named("rim", along_y(jt.shapes.cylinder(0.2, 0.06, sections=32)))
    for wheel, centre in WHEELS.items():
        yield Part(f"tyre_{wheel}", tyre, "tyre_rubber", centre)
        yield Part(f"rim_{wheel}", rim, "aluminium", centre)


if __name__ == "__main__":
    main()

"""`jaxthermo simulate --preview`: the view of the camera, without a run."""

from pathlib import Path

import numpy as np

from ..alike_lines import grouped_lines
from ..config.camera_framing import build_camera
from ..config.loader import load_config
from ..console.results_folder import results_folder
from ..console.terminal import open_console, print_line, status
from ..geometry.mesh import mesh_summary
from ..image.colour.annotate import write_png
from ..image.colour.preview import draw_preview
from ..image.surface.abstract_camera import AbstractCamera
from ..image.surface.camera import Camera, OrthographicCamera
from ..image.surface.visible import WorldMesh
from ..scene.compile.body_names import body_label
from .body_lines import MAX_BODIES


_FILE = "preview.png"


def preview(config: Path, out: Path | None, overrides: tuple[str, ...]) -> None:
    """Write `preview.png` of the scene at its start; print its bodies and camera."""
    scene = load_config(config, overrides)
    console = open_console()
    with status(console, "reading the bodies"):
        meshes = [body.build_mesh() for body in scene.bodies]
        poses = [body.build_pose().at(0.0) for body in scene.bodies]
    world = [
        pose.to_world(mesh.triangles) for mesh, pose in zip(meshes, poses, strict=True)
    ]
    labels = [body_label(n, body.name or "") for n, body in enumerate(scene.bodies)]
    if len(labels) <= MAX_BODIES:
        for label, mesh, triangles in zip(labels, meshes, world, strict=True):
            print_line(console, f"{label}: {mesh_summary(mesh)}")
            print_line(console, f"  {_extent(triangles)}")
    else:
        print_line(console, f"{len(labels):,} bodies {_extent(np.concatenate(world))}")
    camera = build_camera(scene.camera, np.concatenate(world))
    print_line(console, _camera_line(camera))
    with results_folder(out or Path("results") / config.stem) as folder:
        with status(console, "drawing"):
            bodies = [
                WorldMesh(
                    vertices=pose.to_world(mesh.vertices),
                    faces=mesh.faces,
                    is_two_sided=body.wall is not None,
                )
                for body, mesh, pose in zip(scene.bodies, meshes, poses, strict=True)
            ]
            image, visible = draw_preview(
                bodies,
                camera,
                title=scene.name or "",
                names=[body.name or "" for body in scene.bodies],
            )
            write_png(folder / _FILE, image)
        unseen = sorted(set(range(len(meshes))) - set(visible))
        for line in grouped_lines(
            f"{labels[number]} is not in the picture" for number in unseen
        ):
            print_line(console, f"note: {line}")
        print_line(console, f"{folder / _FILE}: nothing was simulated")


def _extent(triangles: np.ndarray) -> str:
    corners = triangles.reshape(-1, 3)
    lowest = _point(corners.min(axis=0))
    highest = _point(corners.max(axis=0))
    return f"in the world from {lowest} to {highest} m; z is up"


def _point(values) -> str:
    return f"({', '.join(f'{value:.4g}' for value in values)})"


def _camera_line(camera: AbstractCamera) -> str:
    position = _point(camera.position)
    target = _point(camera.look_at)
    projection = "orthographic"
    extent = ""
    if isinstance(camera, Camera):
        projection = "pinhole"
        extent = f"{np.rad2deg(camera.field_of_view):.3g} deg"
    elif isinstance(camera, OrthographicCamera):
        extent = f"{camera.view_height:.4g} m"
    return (
        f"camera: {projection} at {position} m, looks at {target} m, "
        f"up {_point(camera.up)}, {extent} from top to bottom, "
        f"{camera.width} x {camera.height} pixels"
    )

"""`jaxthermo simulate --preview`: the view of the camera, without a run."""

from pathlib import Path

import numpy as np

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


_FILE = "preview.png"


def preview(config: Path, out: Path | None, overrides: tuple[str, ...]) -> None:
    """Write `preview.png` of the scene at its start; print its bodies and camera."""
    scene = load_config(config, overrides)
    console = open_console()
    with status(console, "reading the bodies"):
        meshes = [body.build_mesh() for body in scene.bodies]
        poses = [body.pose.build().at(0.0) for body in scene.bodies]
    world = [
        pose.to_world(mesh.triangles) for mesh, pose in zip(meshes, poses, strict=True)
    ]
    for number, (mesh, triangles) in enumerate(zip(meshes, world, strict=True)):
        print_line(console, f"body {number}: {mesh_summary(mesh)}")
        corners = triangles.reshape(-1, 3)
        lowest = _point(corners.min(axis=0))
        highest = _point(corners.max(axis=0))
        print_line(console, f"  in the world from {lowest} to {highest} m; z is up")
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
            image, visible = draw_preview(bodies, camera, scene.name or "")
            write_png(folder / _FILE, image)
        for number in sorted(set(range(len(meshes))) - set(visible)):
            print_line(console, f"note: body {number} is not in the picture")
        print_line(console, f"{folder / _FILE}: nothing was simulated")


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

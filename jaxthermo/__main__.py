"""The command line. Commands import what they need when they run: help stays fast."""

from .console import interrupt as _interrupt  # noqa: F401


# isort: split
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from . import __version__
from .console.entry import Animate, Flag, Overrides, compiles, make_app, run_app
from .errors import InputError
from .extras import require_extra


app: App = make_app(
    "jaxthermo", "Heat transfer on voxels, as a thermal camera sees it.", __version__
)


@app.command
@compiles
def _simulate(
    config: Path,
    /,
    *,
    out: Path | None = None,
    overrides: Overrides = (),
    explain: Flag = False,
    preview: Flag = False,
    animate: Animate = None,
    frame_rate: float | None = None,
    contact_sheet: Flag = False,
    steady: Flag = False,
    at: str | None = None,
    devices: int = 1,
    coordinator: str | None = None,
    processes: int = 1,
    process: int = 0,
) -> None:
    """Run a scene and write its results and frames.

    Args:
        config: Scene, a YAML file.
        out: Folder for the results; results/NAME by default.
        overrides: Value to change, such as bodies.0.pitch=3mm; may be repeated.
        explain: Print the included and omitted terms, and exit.
        preview: Draw the bodies as the camera sees them, with the axes, and exit.
        animate: Write an animation of the frames too; apng by default.
        frame_rate: Frames per second of the animation, by default chosen so that it
            lasts a few seconds.
        contact_sheet: Write all frames on one sheet too.
        steady: Find the temperatures at which the scene no longer changes, in place of
            a run.
        at: Time whose poses and values stay in the steady state, such as "14 h"; the
            start by default.
        devices: Number of devices that share a full volume. On CPUs any number may be
            requested; one device already uses all cores.
        coordinator: Address HOST:PORT of process 0, for a run in several processes.
            Start all of them with the same command except for --process.
        processes: Number of processes of the run, which share the --devices.
        process: Number of this process, from 0.
    """
    if at is not None and not steady:
        raise InputError(f"--at {at}: give --steady too")
    if steady:
        from .cli.steady import check_steady, simulate_steady

        others = {
            "--explain": explain,
            "--preview": preview,
            "--animate": animate is not None,
            "--frame-rate": frame_rate is not None,
            "--contact-sheet": contact_sheet,
            "--devices": devices != 1,
            "--coordinator": coordinator is not None,
            "--processes": processes != 1,
            "--process": process != 0,
        }
        seconds = check_steady(at, others)
        simulate_steady(config, out=out, overrides=overrides, at=seconds)
        return
    # A preview does not need the time loop, which is slow to import.
    if preview:
        from .cli.preview import preview as run_preview

        run_preview(config, out, overrides)
        return
    from .cli.frame_outputs import Extras
    from .cli.simulate import explain as run_explain, simulate as run
    from .parallel.meeting import group_of

    extras = Extras.of(animate, frame_rate, contact_sheet)
    if explain:
        run_explain(config, overrides, devices)
    else:
        group = group_of(
            coordinator, processes=processes, process=process, devices=devices
        )
        run(
            config,
            out=out,
            overrides=overrides,
            extras=extras,
            devices=devices,
            group=group,
        )


@app.command
@compiles
def _view(
    config: Path,
    /,
    *,
    overrides: Overrides = (),
    host: str = "127.0.0.1",
    port: int = 8080,
    rate: float = 20.0,
) -> None:
    """Simulate a scene in a browser, and change its values by hand.

    Args:
        config: Scene, a YAML file.
        overrides: Value to change, such as bodies.0.pitch=3mm; may be repeated.
        host: Address to listen on; 0.0.0.0 to admit other computers.
        port: Port to listen on, or the next free one.
        rate: Simulated seconds per second at the start.
    """
    require_extra("view: it needs", package="viser", extra="view")
    from .cli.view import view as run

    run(config, overrides=overrides, host=host, port=port, rate=rate)


@app.command
@compiles
def _play(
    run: Path,
    /,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    rate: float = 20.0,
) -> None:
    """Show a finished run in a browser, with a slider of time.

    Args:
        run: Folder written by `jaxthermo simulate`.
        host: Address to listen on; 0.0.0.0 to admit other computers.
        port: Port to listen on, or the next free one.
        rate: Seconds of the run per second at the start.
    """
    require_extra("play: it needs", package="viser", extra="view")
    from .cli.view import play

    play(run, host=host, port=port, rate=rate)


@app.command
@compiles
def _render(
    run: Path,
    /,
    *,
    out: Path | None = None,
    overrides: Overrides = (),
    contacts: Flag = False,
    animate: Animate = None,
    frame_rate: float | None = None,
    contact_sheet: Flag = False,
) -> None:
    """Draw new frames of a finished run, without simulating it again.

    Args:
        run: Folder written by `jaxthermo simulate`.
        out: Folder for the frames; that of the run by default.
        overrides: Value of camera or image to change, such as camera.width=320; may
            be repeated.
        contacts: Draw contact textures instead: the surface temperatures where bodies
            touch. The bodies are voxelized again.
        animate: Write an animation of the frames too; apng by default.
        frame_rate: Frames per second of the animation, by default chosen so that it
            lasts a few seconds.
        contact_sheet: Write all frames on one sheet too.
    """
    if contacts:
        from .cli.contacts import render_contacts

        render_contacts(run, out, overrides)
        return
    from .cli.frame_outputs import Extras
    from .cli.frames import render as draw

    draw(
        run,
        out=out,
        overrides=overrides,
        extras=Extras.of(animate, frame_rate, contact_sheet),
    )


@app.command
@compiles
def _export(
    run: Path,
    /,
    *,
    format: Annotated[str, Parameter(name="--format")],
    out: Path | None = None,
    overrides: Overrides = (),
) -> None:
    """Write the surfaces of a finished run for other programs.

    Args:
        run: Folder written by `jaxthermo simulate`.
        format: Kind of the files: vtu for ParaView, with a collection over time; glb
            for Blender and viewers, with temperatures and colours of the vertices; or
            texture for simulators, with images of the temperatures and their meshes.
        out: Folder for the files; RUN/FORMAT by default.
        overrides: Value of image to change, such as image.frames=[60] for one time, or
            image.palette, image.low and image.high for the colours; may be repeated.
    """
    from .cli.export import export as write

    write(run, format=format, out=out, overrides=overrides)


@app.command
@compiles
def _dataset(
    config: Path,
    /,
    *,
    out: Path | None = None,
    overrides: Overrides = (),
    explain: Flag = False,
    workers: int = 1,
) -> None:
    """Write labelled frames of a scene's variations, for detector networks.

    The same command continues after Ctrl-C with the frames that are missing.

    Args:
        config: Dataset, a YAML file with a scene, its variations and cameras.
        out: Folder for the frames; results/NAME by default.
        overrides: Value of the dataset to change, such as samples=3; may be repeated.
        explain: Print the variations, check what the cameras see, and exit.
        workers: Number of processes, each of which simulates and draws runs of its own.
    """
    from .cli.dataset import dataset as write

    write(config, out=out, overrides=overrides, explain=explain, workers=workers)


@app.command
@compiles
def _reduce(
    config: Path,
    /,
    *,
    out: Path | None = None,
    overrides: Overrides = (),
    size: int | None = None,
    tolerance: str | None = None,
    method: str = "krylov",
    check: Flag = False,
) -> None:
    """Reduce a linear scene to a few modes and write its matrices.

    Args:
        config: Scene, a YAML file without emission and other nonlinear terms.
        out: Folder for the results; results/NAME-reduced by default.
        overrides: Value to change, such as bodies.0.pitch=3mm; may be repeated.
        size: Number of vectors; by default as the tolerance requires.
        tolerance: Error of the surface relative to its range; 0.1% by default.
        method: Method of the reduction: krylov for loads of any course in time, or pod
            for the loads of the scene.
        check: Run the full scene too, and compare temperatures and run times.
    """
    from .cli.reduce import reduce as run

    run(
        config,
        out=out,
        overrides=overrides,
        size=size,
        tolerance=tolerance,
        method=method,
        check=check,
    )


@app.command
@compiles
def _voxelize(
    mesh: Path,
    /,
    *,
    pitch: str,
    unit: str | None = None,
    height: str | None = None,
    up: str = "z",
    surface_cells: str = "crossings",
    out: Path | None = None,
) -> None:
    """Voxelize a mesh and report thin parts and depth layers.

    Args:
        mesh: Mesh, an OBJ, PLY, STL, GLB, glTF, OFF, 3MF or DAE file.
        pitch: Edge of a voxel, such as 2mm.
        unit: Length of one file unit, such as mm.
        height: Extent along --up, such as 0.5m, instead of the unit.
        up: Axis of the file that points up: x, y, z, -x, -y or -z.
        surface_cells: Surface of the voxels: crossings (of second order in the pitch)
            or dominant_axis (of first order).
        out: Folder for the results; results/NAME by default.
    """
    from .cli.voxelize import voxelize as run

    run(
        mesh,
        pitch=pitch,
        unit=unit,
        height=height,
        up=up,
        surface_cells=surface_cells,
        out=out or Path("results") / mesh.stem,
    )


@app.command
def _parts(
    mesh: Path,
    /,
    *,
    unit: str | None = None,
    height: str | None = None,
    up: str = "z",
    json: Flag = False,
    scene: Flag = False,
) -> None:
    """List the named parts of a mesh file with their sizes, or begin a scene of them.

    A part is node/mesh/material; a rule of a scene may name it by one of the three.

    Args:
        mesh: Mesh, an OBJ, PLY, STL, GLB, glTF, OFF, 3MF or DAE file.
        unit: Length of one file unit, such as mm; by default as the file states it.
        height: Extent of all parts along --up, such as 0.5m, instead of the unit.
        up: Axis of the file that points up: x, y, z, -x, -y or -z.
        json: Print plain values instead of a table.
        scene: Print the start of a scene, an assembly of these parts, instead.
    """
    from .cli.parts import parts as show

    show(mesh, unit=unit, height=height, up=up, as_json=json, as_scene=scene)


@app.command
def _materials(
    name: str | None = None,
    /,
    *,
    emissivity: Flag = False,
) -> None:
    """List the named materials, or show one with its source.

    Args:
        name: Name of a material, such as stainless_steel, or a part of it.
        emissivity: List surfaces by their finish instead.
    """
    from .cli.materials import materials as show

    show(name, emissivity)


@app.command
def _palettes() -> None:
    """List the colour scales and the differences between their colours."""
    from .cli.palettes import palettes as show

    show()


@app.command
def _example(name: str | None = None, /, *, out: Path | None = None) -> None:
    """List the example scenes, or print or write one of them.

    Args:
        name: Name of an example, such as figurine.
        out: File to write; without it the scene is printed.
    """
    from .cli.example import example as run

    run(name, out)


@app.command
def _cache(action: Literal["show", "clear"] = "show", /, *categories: str) -> None:
    """Show what the user's cache holds, or clear it.

    It holds what earlier runs computed from geometry alone, structures, the reference
    runs of fits, and compiled programs. JAXTHERMO_CACHE names its folder or turns it
    off; JAXTHERMO_CACHE_GIB is the limit of its size.

    Args:
        action: show prints the number and size of files by category; clear removes
            them.
        categories: Categories to clear, such as reference; all by default.
    """
    from .cli.cache import clear_cache, show_cache

    if action == "clear":
        clear_cache(categories)
    elif categories:
        raise InputError("cache show: takes no categories; clear does")
    else:
        show_cache()


@app.command
def _schema(name: str = "scene", /) -> None:
    """Print the JSON Schema of a scene or a dataset, with units, for editors.

    Args:
        name: Kind of config: scene or dataset.
    """
    from .config.json_schema import json_schema
    from .config.schema.dataset import DatasetConfig
    from .config.schema.scene import SceneConfig

    models = {"scene": SceneConfig, "dataset": DatasetConfig}
    if name not in models:
        raise InputError(f"schema {name}: choose {' or '.join(models)}")
    sys.stdout.write(json_schema(models[name]))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command and exit: status 0 on success, 2 for a mistake of the user."""
    run_app(app, "jaxthermo", arguments)


if __name__ == "__main__":
    main()

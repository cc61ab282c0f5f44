"""The command line. Commands import what they need when they run: help stays fast."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from . import __version__
from .cli.entry import run_app


app = App(
    name="jaxthermo",
    help="What a thermal camera sees of a triangle mesh over time.",
    version=__version__,
    # `main` tells where the run was stopped.
    suppress_keyboard_interrupt=False,
)

Overrides = Annotated[
    tuple[str, ...],
    Parameter(name="--set", negative="", metavar="KEY=VALUE", show_default=False),
]


@app.command
def simulate(
    config: Path,
    /,
    *,
    out: Path | None = None,
    overrides: Overrides = (),
    explain: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Run a scene and write its results and frames.

    Args:
        config: The scene, a YAML file.
        out: The folder for the results; results/NAME if not given.
        overrides: A value to change, such as bodies.0.pitch=3mm; may be repeated.
        explain: Only tell what would be computed, what is left out and why.
    """
    from .cli.simulate import explain as tell, simulate as run

    if explain:
        tell(config, overrides)
    else:
        run(config, out, overrides)


@app.command
def render(run: Path, /, *, out: Path | None = None, overrides: Overrides = ()) -> None:
    """Draw new frames of a run, without simulating it again.

    Args:
        run: The folder that `jaxthermo simulate` left.
        out: The folder for the frames; the run's own if not given.
        overrides: A value of camera or image to change, such as camera.width=320; may
            be repeated.
    """
    from .cli.render import render as draw

    draw(run, out, overrides)


@app.command
def voxelize(
    mesh: Path,
    /,
    *,
    pitch: str,
    unit: str | None = None,
    height: str | None = None,
    up: str = "z",
    out: Path | None = None,
) -> None:
    """Voxelize a mesh and report what is left of it.

    Args:
        mesh: An OBJ, PLY, STL, GLB or OFF file.
        pitch: Edge of a voxel, such as 2mm.
        unit: Length of one file unit, such as mm.
        height: Instead of the unit: the extent along up, such as 0.5m.
        up: The file's axis that points up: x, y, z, -x, -y or -z.
        out: The folder for the results; results/NAME if not given.
    """
    from .cli.voxelize import voxelize as run

    run(mesh, pitch, unit, height, up, out or Path("results") / mesh.stem)


@app.command
def materials(
    name: str | None = None,
    /,
    *,
    emissivity: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """List the named materials, or show one with its source.

    Args:
        name: A material, such as stainless_steel, or a part of its name.
        emissivity: List surfaces by their finish instead.
    """
    from .cli.materials import materials as show

    show(name, emissivity)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs one command and exits: 0 if it worked, 2 for a mistake of the user."""
    run_app(app, "jaxthermo", arguments)


if __name__ == "__main__":
    main()

"""`jaxthermo render`: new frames from the stored solution of a run."""

from pathlib import Path

from ..arrays import precision
from ..config.loader import load_config
from ..config.schema.scene import SceneConfig
from ..errors import InputError
from ..integrate.run.solution_file import load_solution
from .console import open_console, print_line, status
from .files import FRAMES, results_folder
from .frames import FrameCamera, write_frames


def render(run: Path, out: Path | None, overrides: tuple[str, ...]) -> None:
    """Draw the frames of a run again, with changes of camera or image."""
    for name in ("config.yaml", "solution.npz"):
        if not (run / name).is_file():
            raise InputError(
                f"{run}: has no {name}; name a folder written by `jaxthermo simulate`"
            )
    for text in overrides:
        if text.split(".")[0].split("=")[0].strip() not in ("camera", "image"):
            raise InputError(
                f"--set {text}: only camera and image can change after the run; "
                "use `jaxthermo simulate` for the rest"
            )
    # The solution contains the surface: the mesh file may be gone since.
    config = load_config(run / "config.yaml", overrides, find_meshes=False)
    _render_run(config, run, out or run)


def _render_run(config: SceneConfig, run: Path, out: Path) -> None:
    """Draw the saved times of the run in the folder `run` as frames in `out`."""
    console = open_console()
    with precision(config.dtype), status(console, "drawing frames"):
        stored = load_solution(run / "solution.npz")
        terms = tuple(term.build() for term in config.terms)
        camera = FrameCamera(config, stored.surfaces, terms)
        with results_folder(out) as folder:
            count = write_frames(config, camera, stored, folder / FRAMES)
    print_line(console, f"{count} frame{'s' * (count != 1)} in {out / FRAMES}")

"""`jaxthermo render`: new frames from the solution that a run left behind."""

from pathlib import Path

from ..arrays import precision
from ..config.loader import load_config
from ..config.schema.scene import SceneConfig
from ..errors import InputError
from ..integrate.run.solution_file import load_solution
from .console import doing, open_console, tell
from .files import FRAMES, results_folder
from .frames import Watch, write_frames


def render(run: Path, out: Path | None, overrides: tuple[str, ...]) -> None:
    """Reads what the run left, with another camera or image if so asked."""
    for name in ("config.yaml", "solution.npz"):
        if not (run / name).is_file():
            raise InputError(
                f"{run}: has no {name}; name a folder that `jaxthermo simulate` left"
            )
    for text in overrides:
        if text.split(".")[0].split("=")[0].strip() not in ("camera", "image"):
            raise InputError(
                f"--set {text}: only camera and image can change after the run; "
                "use `jaxthermo simulate` for the rest"
            )
    # The solution holds the surface: the mesh may have gone since.
    config = load_config(run / "config.yaml", overrides, find_meshes=False)
    render_run(config, run, out or run)


def render_run(config: SceneConfig, run: Path, out: Path) -> None:
    """Draws the saved times of the run in `run` as frames in `out`."""
    console = open_console()
    with precision(config.dtype), doing(console, "drawing frames"):
        stored = load_solution(run / "solution.npz")
        terms = tuple(term.build() for term in config.terms)
        watch = Watch(config, stored.surfaces, terms)
        with results_folder(out) as folder:
            count = write_frames(config, watch, stored, folder / FRAMES)
    tell(console, f"{count} frame{'s' * (count != 1)} in {out / FRAMES}")

"""A scene file in Python: its scene, its run, and its camera."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ..arrays import precision
from ..atomic import write_text
from ..errors import InputError
from ..image.radiance.image import Image
from ..image.render import recorded_frames
from ..image.surface.abstract_camera import AbstractCamera
from ..integrate.run.abstract_solution import AbstractSolution
from ..integrate.run.plan import Plan, plan_run
from ..integrate.run.simulate import simulate
from ..integrate.run.solution import Solution
from ..integrate.solvers import AbstractSolver
from ..progress import Progress
from ..scene.scene import Scene
from .camera_framing import build_recorder, camera_on
from .loader import load_config, to_yaml
from .schema.scene import SceneConfig


def plan_of(config: SceneConfig, scene: Scene) -> Plan:
    """Plan the run that a config asks for, of the scene that it builds."""
    return plan_run(
        scene,
        t1=config.time.end,
        save_at=config.time.save_times,
        solver=config.solver.build(),
        control_error=True,
    )


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene, its run and its camera, from a file by `load_scene`."""

    config: SceneConfig
    """All values of the file in SI units, with overrides and defaults."""

    @cached_property
    def scene(self) -> Scene:
        """The scene, with its meshes loaded and voxelized when it is first read.

        Raises:
            InputError: for a mesh, labels, mask or fit card that cannot be used.
        """
        with precision(self.config.dtype):
            return self.config.build()

    @property
    def t1(self) -> float:
        """End of the run [s]."""
        return self.config.time.end

    @property
    def save_at(self) -> tuple[float, ...]:
        """Times at which the run is saved [s]."""
        return self.config.time.save_times

    @cached_property
    def solver(self) -> AbstractSolver | None:
        """Time integration; None for the default of `simulate`."""
        return self.config.solver.build()

    def simulate(
        self,
        *,
        throw: bool = True,
        devices: int = 1,
        progress: Callable[[], AbstractContextManager[Progress]] | None = None,
    ) -> Solution:
        """Run the scene as the file asks for; arguments and errors of `simulate`."""
        return simulate(
            self.scene,
            self.t1,
            self.save_at,
            solver=self.solver,
            throw=throw,
            devices=devices,
            progress=progress,
        )

    def camera(self, solution: AbstractSolution) -> AbstractCamera:
        """The camera of the file, which shows all bodies where the file has none."""
        return camera_on(self.config.camera, solution.surfaces)

    def render(self, solution: AbstractSolution, index: int = -1) -> Image:
        """Draw a saved time with the camera, band and effects of the file.

        Raises:
            InputError: as `render`.
        """
        return self._frame(solution)(range(len(solution.times))[index])

    def frames(self, solution: AbstractSolution) -> Iterator[Image]:
        """Draw all saved times with the camera, band and effects of the file.

        Raises:
            InputError: as `render`.
        """
        return map(self._frame(solution), range(len(solution.times)))

    def _frame(self, solution: AbstractSolution) -> Callable[[int], Image]:
        recorder = build_recorder(self.camera(solution), self.config.image)
        return recorded_frames(recorder, solution)

    def save(self, path: str | Path) -> None:
        """Write the scene as a file that loads to an equal one.

        Values are in SI units, assemblies are written as bodies, and overrides are
        part of the file. It names the same meshes.

        Raises:
            InputError: if the file cannot be written.
        """
        write_text(Path(path).expanduser(), to_yaml(self.config))


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> SceneFile:
    """Read a scene file, as `jaxthermo simulate` does.

    Args:
        path: YAML file. Meshes are searched for in its folder, then in those of the
            variable JAXTHERMO_MESHES.
        overrides: changes such as "terms.0.irradiance=500 W/m^2", as after `--set`.

    Raises:
        InputError: one line for each mistake in the file or the overrides.
    """
    if isinstance(overrides, str):
        raise InputError(
            f"load_scene(overrides={overrides!r}): give a list of texts, such as "
            f"[{overrides!r}]"
        )
    return SceneFile(load_config(Path(path).expanduser(), tuple(overrides)))

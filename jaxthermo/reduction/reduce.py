"""`reduce`: from a linear scene to a reduced model."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from ..choices import ReductionMethod
from ..errors import InputError, require
from ..host_memory import require_memory
from ..integrate.run.abstract_solution import StoredSolution
from ..scene.scene import Scene
from .basis import Basis, project, snapshots
from .linear_system import LinearSystem
from .offline import (
    MAX_BLOCKS,
    Log,
    Target,
    chosen_basis,
    krylov_modes,
    make_model,
    target_of,
)
from .reduced_model import AbstractOffline, ReducedModel
from .span import check_same_bodies, input_shares, start_in_span


_TOLERANCE = 1e-3
"""Default of the surface's error over its range [-]."""


def reduce(
    scene: Scene,
    t1: float | int,
    save_at: Sequence[float] | None = None,
    *,
    size: int | None = None,
    tolerance: float | None = None,
    method: ReductionMethod = "krylov",
    log: Log = lambda text: None,
) -> ReducedModel:
    """Reduce a linear scene to a few modes, for loads of its own patterns.

    From C dx/dt = -K x + B u(t) for all nodes to dz/dt = A z + V^T B u(t) for x = V z,
    with V^T C V = 1 and A = -V^T K V, which stays symmetric: by rational Krylov vectors
    (s C + K)^-1 B for rates s over all time scales of the run, or by snapshots of it.
    Loads that are linear between knots are stepped exactly; others are sampled.

    Args:
        scene: linear: constant properties and coefficients, no emission.
        t1: end of the run [s].
        save_at: increasing times to save [s]; None for the end. The model need not be
            right between a change of the loads and the next save time.
        size: number of vectors; None for as many as the tolerance requires.
        tolerance: estimated root mean square error of the surface over its range [-];
            None for 0.001.
        method: "krylov", also good for other amplitudes of its loads; or "pod",
            snapshots of the scene's own run, whose errors hold for it alone: a run
            with other loads or from another start warns.
        log: receives a line before each slow stage.

    Raises:
        InputError: naming the term that is not linear, or for times out of order.

    Example:
        >>> import jaxthermo as jt
        >>> steel = jt.Material(16.0, density=8000.0, specific_heat=500.0)
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> body = jt.Body(jt.FullVolume(grid), steel, temperature=290.0)
        >>> heat = jt.HeatFlux(1000.0, on=jt.Side((1, 0, 0)))
        >>> scene = jt.Scene((body,), (heat, jt.Convection(10.0, 290.0)))
        >>> model = jt.reduce(scene, 60.0, [30.0, 60.0], size=4)
        >>> model.size, model.surface_temperature.shape
        (4, (2, 96))
    """
    require(scene, classes=Scene, argument="reduce(scene=)", give="a Scene")
    _check_options(size, tolerance, method)
    clock = time.perf_counter()
    log("building the scene")
    target = target_of(scene, t1, save_at)
    allowed = _TOLERANCE if tolerance is None else tolerance
    _check_memory(target.system)
    if method == "krylov":
        modes = krylov_modes(target, size=size, tolerance=allowed, log=log)
    else:
        log("running the scene for its snapshots")
        states = snapshots(target.system, target.plan, target.amplitudes)
        empty = Basis.empty(target.system)
        modes = project(target.system, empty.with_vectors(target.system, states))
    log("choosing the vectors")
    basis, errors = chosen_basis(target, modes=modes, size=size, tolerance=allowed)
    model, model_basis = make_model(
        target,
        basis=basis,
        errors=errors,
        method=method,
        solves=modes.basis.size,
        clock=clock,
        log=log,
    )
    return replace(model, offline=_Offline(target, model_basis, allowed))


def _check_options(size: int | None, tolerance: float | None, method: str) -> None:
    if size is not None and tolerance is not None:
        raise InputError("reduce: give a size or a tolerance, not both")
    if size is not None and size < 1:
        raise InputError(f"reduce(size={size}): give 1 or more")
    if tolerance is not None and not 0 < tolerance < 1:
        raise InputError(
            f"reduce(tolerance={tolerance!r}): give a fraction between 0 and 1, such "
            "as 0.001 for 0.1 %"
        )
    if method not in ("krylov", "pod"):
        raise InputError(f"reduce(method={method!r}): give 'krylov' or 'pod'")


def _check_memory(system: LinearSystem) -> None:
    columns = MAX_BLOCKS * (len(system.inputs) + 1)
    count = 3 * len(system.capacity) + len(system.area)
    remedy = "use a coarser structure, such as Aggregate"
    require_memory(8 * columns * count, "reducing this scene", remedy)


@dataclass(frozen=True, eq=False)
class _Offline(AbstractOffline):
    """The run, the basis and the tolerance from which a model was made."""

    target: Target
    basis: Basis
    tolerance: float

    @override
    def run_of(self, model: ReducedModel, scene: Scene) -> StoredSolution:
        scene_target = target_of(scene, self.target.times[-1], self.target.times)
        system = self.target.system
        check_same_bodies(system, scene_target.system)
        shares, outside = input_shares(system, scene_target.system)
        if outside:
            name = scene_target.system.inputs[outside[0]].name
            raise InputError(
                f"reduced model: the pattern of {name} is not one of its loads: "
                "model.extend(scene) adds it"
            )
        start = start_in_span(
            system,
            other_system=scene_target.system,
            basis=self.basis,
            start=model.start,
        )
        moved = replace(model, start=start)
        if start is not model.start:
            model.warn_of_snapshots("starts")
        return moved.run(
            scene_target.knots, scene_target.amplitudes @ shares.T, scene_target.times
        )

    @override
    def extended(self, model: ReducedModel, scene: Scene) -> ReducedModel:
        clock = time.perf_counter()
        target = self.target
        scene_target = target_of(scene, target.times[-1], target.times)
        check_same_bodies(target.system, scene_target.system)
        _, outside = input_shares(target.system, scene_target.system)
        new_inputs = [scene_target.system.inputs[n] for n in outside]
        target = target._replace(
            system=target.system.with_inputs(new_inputs),
            # The new inputs are 0 in the model's own scene.
            amplitudes=np.pad(target.amplitudes, ((0, 0), (0, len(outside)))),
            ranges=(*target.ranges, *(scene_target.ranges[n] for n in outside)),
        )
        modes = krylov_modes(
            scene_target, size=None, tolerance=self.tolerance, log=_silent
        )
        added_basis, _ = chosen_basis(
            scene_target, modes=modes, size=None, tolerance=self.tolerance
        )
        vectors = [scene_target.system.start, *added_basis.vectors.T]
        about = model.about
        extended, basis = make_model(
            target,
            basis=self.basis.with_vectors(target.system, vectors),
            errors=np.array(about.estimate_kelvin),
            method=about.method,
            solves=about.solves + modes.basis.size,
            # The model and its extension took the sum of both times.
            clock=clock - about.offline_s,
            log=_silent,
        )
        return replace(extended, offline=_Offline(target, basis, self.tolerance))


def _silent(text: str) -> None:
    del text

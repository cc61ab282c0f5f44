"""Heated from one side and then left alone: where every structure ends."""

import math
from collections.abc import Iterator
from functools import cached_property, partial

import numpy as np

from jaxthermo.physics.radiation.source import Sun
from jaxthermo.physics.time_varying import Until
from jaxthermo.scene.scene import Scene

from .cases import NEAREST, Case, Subject, all_cases, load_subject
from .config import FULL, EquilibriumConfig
from .measure import build_timed
from .record import Arrays, Row
from .runner import finish, prepare
from .study import Study


TIME_CONSTANTS = 40.0
"""Of a bar as long as the body is high, H^2 / (pi^2 alpha)."""


class Equilibrium:
    """One body of the comparison, coarse, insulated, in float64."""

    def __init__(self, study: Study, config: EquilibriumConfig):
        """Nothing is loaded or run yet."""
        self.study = study
        self.config = config

    @cached_property
    def subject(self) -> Subject:
        """The body at the pitch of this claim."""
        study = self.study
        return load_subject(study.body, study.config, self.config.voxels_high)

    def rows(self) -> Iterator[Row]:
        """One row for each structure of the comparison."""
        study, high = self.study, self.config.voxels_high
        for case in all_cases(study.config):
            identity = {**study.identity, "equilibrium": [high, case.identity]}
            head = {
                "what": "equilibrium",
                "body": study.body.name,
                "label": case.label,
            }
            yield study.record.once(identity, head, partial(self._row, case))

    @property
    def end(self) -> float:
        """When the body is even to rounding, or nearly so for a slow structure [s]."""
        subject = self.subject
        height = float(np.ptp(subject.grid.mesh.bounds[:, 2]))
        diffusivity = float(subject.material.diffusivity)
        return TIME_CONSTANTS * height**2 / (math.pi**2 * diffusivity)

    def _scene(self, case: Case) -> Scene:
        config, subject = self.study.config, self.subject
        structure, _ = build_timed(lambda: case.make(subject.grid))
        nearest = case.label == FULL
        body = subject.body(structure, NEAREST if nearest else self.study.surface_map)
        sun = subject.sun(config.picture.load)
        hot = Until(config.sun.irradiance, config.sun.until or config.time.end)
        heat = Sun(direction=sun.direction, irradiance=hot)
        return Scene((body,), (heat,), dtype="float64")

    def _row(self, case: Case) -> tuple[Row, Arrays]:
        scene, end = self._scene(case), self.end
        solution = finish(prepare(scene, end, (end,)))
        surface = np.asarray(solution.surface_temperature[0])
        row = {
            "nodes": solution.receipt.nodes,
            "capacity_ratio": solution.receipt.capacity_ratios[0],
            "steps": solution.run.steps,
            "end_s": end,
            "mean_K": float(solution.mean_temperature[0, 0]),
            "rise_K": float(solution.mean_temperature[0, 0]) - self._start,
            "surface_range_K": float(surface.max() - surface.min()),
        }
        return row, {}

    @property
    def _start(self) -> float:
        return float(self.study.config.temperature)

"""Observations whose values are those of several passes, each of its own parts."""

from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Int

from ...arrays import device_array
from ..part_stepper import PartStepper
from .plan import Plan
from .solution import Observation


class PartNumbers(NamedTuple):
    """Number of the part of each value of an observation, see `PartStepper`."""

    of_fragment: Int[np.ndarray, " s"]
    of_body: Int[np.ndarray, " b"]
    of_entry: Int[np.ndarray, " c"]
    """Number of each entry of the ledger; its bodies are of one part."""
    of_probe: Int[np.ndarray, " p"]

    @classmethod
    def of(cls, plan: Plan) -> "PartNumbers | None":
        """Return the numbers of a plan; None where the scene is one part."""
        stepper = plan.stepper
        if not isinstance(stepper, PartStepper):
            return None
        program = plan.compiled.program
        of_group = np.zeros(len(program.bodies), int)
        for number, groups in enumerate(stepper.groups):
            of_group[list(groups)] = number
        fragments = program.fragments()
        of_fragment = np.zeros(sum(body.node.shape[0] for body in program.bodies), int)
        of_body = np.zeros(program.body_count, int)
        for number, body, numbers in zip(
            of_group, program.bodies, fragments, strict=True
        ):
            of_fragment[numbers] = number
            of_body[list(body.numbers)] = number
        of_probe = np.zeros(sum(len(probes.number) for probes in program.probes), int)
        for probes in program.probes:
            of_probe[list(probes.number)] = of_group[probes.body]
        return cls(
            of_fragment=of_fragment,
            of_body=of_body,
            of_entry=of_body[[bodies[0] for _, bodies in program.entries]],
            of_probe=of_probe,
        )

    @property
    def count(self) -> int:
        """Number of parts."""
        return int(self.of_body.max()) + 1

    def merged(
        self,
        latest: Observation,
        previous: Observation,
        is_latest: Bool[np.ndarray, " parts"],
    ) -> Observation:
        """Return the latest values of some parts, and the previous ones of others."""

        def merge(numbers: Int[np.ndarray, " n"], new: Array, old: Array) -> Array:
            return device_array(np.where(is_latest[numbers], new, old))

        probe_temperature = None
        if latest.probe_temperature is not None:
            assert previous.probe_temperature is not None
            probe_temperature = merge(
                self.of_probe, latest.probe_temperature, previous.probe_temperature
            )
        return latest._replace(
            surface_temperature=merge(
                self.of_fragment,
                latest.surface_temperature,
                previous.surface_temperature,
            ),
            mean_temperature=merge(
                self.of_body, latest.mean_temperature, previous.mean_temperature
            ),
            stored_heat=merge(self.of_body, latest.stored_heat, previous.stored_heat),
            ledger=jax.tree.map(
                partial(merge, self.of_entry), latest.ledger, previous.ledger
            ),
            probe_temperature=probe_temperature,
            fragment_outputs=jax.tree.map(
                partial(merge, self.of_fragment),
                latest.fragment_outputs,
                previous.fragment_outputs,
            ),
        )

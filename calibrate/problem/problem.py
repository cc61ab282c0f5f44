"""A fit as one function: free numbers in, misfits of all cases out."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxthermo.errors import InputError
from jaxthermo.integrate.run.parametric_run import Layout, Response
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.scene.scene import Scene

from ..solvers.jaxpr_function import Traced, trace
from .parameters import Free, ParameterSet
from .targets import AbstractTarget


AT_ONCE = 2**30
"""Bytes of the states of a batch of derivatives."""

MARGIN = 1.25
"""Of the first steps: so much stiffer a fit may get before it takes more."""

FIXED_MARGIN = 2.0
"""Of steps that stay: values that are stiffer than that are not finite, and refused."""


@dataclass(frozen=True, eq=False)
class Case:
    """One run that is compared with data."""

    name: str
    scene: Scene
    """With the values at the start."""
    response: Response
    target: AbstractTarget

    def __post_init__(self):
        if tuple(self.response.saves) != tuple(self.target.moments):
            raise InputError(
                f"case {self.name}: its data are of {list(self.target.moments)} s and "
                f"the run saves {list(self.response.saves)} s"
            )


class Seen(NamedTuple):
    """What a point of a fit gives besides its misfits."""

    stable_step: Float[Array, " c"]
    """Of every case [s]."""
    finite: Bool[Array, ""]
    errors: tuple[Float[Array, " t"], ...]
    """Of every case at every time: root of the sum of its squared misfits."""

    def known_errors(self) -> tuple[Float[np.ndarray, " t"], ...]:
        """The errors on the host."""
        return tuple(np.asarray(each, float) for each in self.errors)


Layouts = tuple[Layout, ...]


@dataclass(frozen=True, eq=False)
class Problem:
    """Parameters and the cases that they are fitted to."""

    parameters: ParameterSet
    cases: tuple[Case, ...]
    worst: float = 2.0
    """Power of the times' errors that is summed, see `emphasized`."""

    def __post_init__(self):
        if not self.cases:
            raise InputError("a fit needs one case at least")
        for case in self.cases:
            self.parameters.check(case.scene)

    @property
    def dtype(self) -> Any:
        """Of all runs."""
        return jnp.dtype(self.cases[0].scene.dtype)

    @property
    def known_sd(self) -> float | None:
        """That noise gives a misfit; None if it is not known."""
        found = {case.target.known_sd for case in self.cases}
        if len(found) > 1:
            raise InputError("cases: fit to references or to frames, not to both")
        known = found.pop()
        return None if known is None else known / math.sqrt(len(self.cases))

    def start(self) -> Float[Array, " p"]:
        """The free numbers that a fit starts from."""
        return jnp.zeros(self.parameters.size, self.dtype)

    def scene(self, case: Case, z: Free) -> Scene:
        """A case's scene with the values of free numbers."""
        return self.parameters.put(case.scene, z)

    def layouts(self, longest: list[float] | None = None) -> Layouts:
        """When each case steps.

        Args:
            longest: step of each, if it goes by stability [s]; the stable one at the
                start, with a margin, if not given.
        """
        found = []
        for n, case in enumerate(self.cases):
            given = longest[n] if longest is not None else None
            if given is None and case.response.follows_stability:
                given = float(case.response.stable_step(case.scene)) / MARGIN
            found.append(case.response.layout(case.scene, given))
        return tuple(found)

    def misfits(self, z: Free, layouts: Layouts) -> tuple[Float[Array, " r"], Seen]:
        """Of all cases, one after the other, and of the priors."""
        rows, steps, errors, finite = [], [], [], jnp.asarray(True)
        for case, layout in zip(self.cases, layouts, strict=True):
            scene = self.scene(case, z)
            answer = case.response(scene, layout)
            misfit = case.target.misfit(scene, answer)
            rows.append(emphasized(misfit, self.worst).reshape(-1))
            errors.append(jnp.sqrt(len(misfit) * (misfit * misfit).sum(axis=1)))
            steps.append(answer.stable_step)
            finite = finite & answer.finite
        z = jnp.asarray(z)
        share = 1 / math.sqrt(len(self.cases))
        data = share * jnp.concatenate(rows)
        prior = self.parameters.prior_misfit(z)
        sd = self.known_sd
        unit = 1.0 if sd is None else sd
        rough = self.parameters.roughness(z)
        both = jnp.concatenate([data, unit * prior, unit * rough])
        return both.astype(z.dtype), Seen(jnp.stack(steps), finite, tuple(errors))

    def stable_steps(self, z: Free) -> Float[Array, " c"]:
        """Of every case [s]; infinite where the solver gives its own steps."""
        each = [
            jnp.asarray(case.response.stable_step(self.scene(case, z)), z.dtype)
            if case.response.follows_stability
            else jnp.asarray(jnp.inf, z.dtype)
            for case in self.cases
        ]
        return jnp.stack(each)

    def with_fixed_steps(self) -> "Problem":
        """The same with steps of a given length, which reverse mode needs.

        Where they go by stability they have a margin of `FIXED_MARGIN`.
        """
        cases = []
        for case in self.cases:
            response = case.response
            if response.follows_stability:
                dt = float(response.stable_step(case.scene)) / FIXED_MARGIN
                if not np.isfinite(dt):
                    dt = response.saves[-1]
                response = replace(response, solver=ForwardEuler(dt=dt))
            cases.append(replace(case, response=response))
        return replace(self, cases=tuple(cases))

    def backward(self, memory: int) -> "Problem":
        """The same for derivatives in reverse mode.

        Args:
            memory: for the states of a run [bytes].
        """
        cases = (
            replace(c, response=replace(c.response, reverse_memory=memory))
            for c in self.cases
        )
        return replace(self, cases=tuple(cases))

    def trace(self, layouts: Layouts) -> Traced:
        """`misfits` as a program that takes free numbers and layouts."""
        return trace(self.misfits, self.start(), layouts)

    def batch(self) -> int:
        """How many derivatives to take at once."""
        values = sum(
            int(np.prod(body.structure.state_shape))
            for case in self.cases
            for body in case.scene.bodies
        )
        each = 4 * values * self.dtype.itemsize
        return int(max(1, min(self.parameters.size, AT_ONCE // max(each, 1))))


def emphasized(rows: Float[Array, "t r"], power: float) -> Float[Array, "t r"]:
    """Misfits whose squares sum to the mean over times of |e_t|^p.

    e_t is a time's error, the root of the sum of its squares; p = 2 leaves all as it
    is, and a larger p counts the worst times more.

        r' = r |e_t|^(p/2 - 1) n^(p/4 - 1/2)

    Args:
        rows: misfits, a row a time, n of them; their squares sum to the mean of e_t^2.
        power: p.
    """
    if power == 2:
        return rows
    square = (rows * rows).sum(axis=1, keepdims=True)
    # The root has no slope at 0, where there is nothing to weigh.
    safe = jnp.where(square > 0, square, 1.0)
    weight = jnp.where(square > 0, safe ** (power / 4 - 0.5), 0.0)
    return rows * weight * len(rows) ** (power / 4 - 0.5)


def with_jacobian(
    function: Callable[..., tuple[Float[Array, " r"], Any]],
    z: Free,
    batch: int,
) -> tuple[Float[Array, " r"], Float[Array, "p r"], Any]:
    """A function's value, its derivatives by each number, and what it gives besides.

    Args:
        function: of free numbers.
        z: where.
        batch: derivatives at once.
    """
    along = lambda t: jax.jvp(function, (z,), (t,), has_aux=True)
    directions = jnp.eye(len(z), dtype=z.dtype)
    if batch >= len(z):
        # The value comes with them: one run less.
        return jax.vmap(along, out_axes=(None, 0, None))(directions)
    value, aux = function(z)
    rows = jax.lax.map(lambda t: along(t)[1], directions, batch_size=batch)
    return value, rows, aux


@eqx.filter_jit
def jacobian_rows(
    function: Callable[..., tuple[Float[Array, " r"], Any]],
    program: Any,
    z: Free,
    batch: int,
) -> Float[Array, "p r"]:
    """The derivatives alone, compiled once for a function and programs of one shape.

    Args:
        function: of a program and free numbers.
        program: its arrays are arguments of what is compiled.
        z: where.
        batch: derivatives at once.
    """
    return with_jacobian(lambda y: function(program, y), z, batch)[1]


def call(program: tuple[Traced, Any], z: Free) -> tuple[Float[Array, " r"], Any]:
    """A traced function of free numbers and layouts, as `jacobian_rows` takes it."""
    traced, layouts = program
    return traced(z, layouts)

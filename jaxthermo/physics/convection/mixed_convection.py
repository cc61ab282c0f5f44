"""Wind and free convection that act on one surface together.

    h^3 = sum of h_j^3,    q_i = h_i (h_i / h)^2 (T_i - T_s)

with the coefficients h_j of all mechanisms j alone: the stronger one determines h
nearly alone, and what each brings adds up to h. The power of 3 is that of flows along
each other and across each other (Churchill 1977, AIChE Journal 23, 10; 7/2 for level
plates and 4 for cylinders and spheres are in use, too). Flows against each other, of
which h^3 is the difference, are not told apart.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ..flux_law import Forcing
from ..surface import Binding, overlap
from .film import AbstractFilmLaw, FilmState


class MixedConvection(AbstractFilmLaw):
    """Heat flux by one mechanism of convection beside others [W/m^2]."""

    law: AbstractFilmLaw
    """Law of the mechanism alone."""
    others: tuple[AbstractFilmLaw, ...]
    """Laws of the other mechanisms alone."""
    acts: tuple[Float[Any, " m"], ...]
    """1 where each of these acts, 0 elsewhere."""

    @override
    def state(self, time, theta) -> FilmState:
        alone = self.law.state(time, theta)
        cubes = alone.h**3
        changes = alone.h**2 * alone.dh
        for law, acts in zip(self.others, self.acts, strict=True):
            other = law.state(time, theta)
            cubes = cubes + jnp.asarray(acts) * other.h**3
            changes = changes + jnp.asarray(acts) * other.h**2 * other.dh
        # Cells on which none of them acts have no coefficient.
        cubes = jnp.where(cubes > 0, cubes, 1)
        share = (alone.h / jnp.cbrt(cubes)) ** 2
        return FilmState(
            difference=alone.difference,
            h=share * alone.h,
            dh=share * (3 * alone.dh - 2 * alone.h * changes / cubes),
        )

    @override
    def slope(self, time, theta) -> Float[Array, "*#m"]:
        return jnp.maximum(super().slope(time, theta), 0)

    @override
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        # No mechanism brings more beside others than alone, nor changes faster, as long
        # as its coefficient grows with the difference by a power below 1/2.
        return self.law.max_slope(hottest, end)

    @override
    def max_flux(self, within: Forcing, end: float) -> float | Float[Array, ""]:
        return self.law.max_flux(within, end)

    @override
    def coarsened(self, mean: Callable[[Array], Array]) -> "MixedConvection":
        return MixedConvection(
            self.law.coarsened(mean),
            others=tuple(law.coarsened(mean) for law in self.others),
            acts=tuple(mean(acts) for acts in self.acts),
        )

    @override
    def above(self, reference: Any) -> "MixedConvection":
        return replace(
            self,
            law=self.law.above(reference),
            others=tuple(law.above(reference) for law in self.others),
        )


class Beside(NamedTuple):
    """A binding of convection beside another one."""

    place: int
    """Its place among the bindings."""
    acts: Float[np.ndarray, " s"]
    """1 on fragments on which both act, 0 elsewhere."""


def mixing(
    bindings: Sequence[tuple[int, Binding]],
    fraction: Callable[[int], Float[np.ndarray, " s"]],
    dtype: Any,
) -> dict[int, list[Beside]]:
    """Bindings of convection beside which others act, by their places, with these.

    Args:
        bindings: with the numbers of their terms. Bindings of one term do not mix.
        fraction: of each fragment that the binding of a place ever acts on.
        dtype: of the state.
    """
    terms = {
        place: number
        for place, (number, binding) in enumerate(bindings)
        if isinstance(binding.law, AbstractFilmLaw)
    }
    if len(set(terms.values())) < 2:
        return {}
    fractions = {place: fraction(place) for place in terms}
    beside: dict[int, list[Beside]] = {}
    for first, second in permutations(terms, 2):
        acts = overlap(fractions[first], fractions[second])
        if terms[first] != terms[second] and acts.any():
            beside.setdefault(first, []).append(Beside(second, acts.astype(dtype)))
    return beside


def mixed_law(
    neighbours: Sequence[Beside], law: AbstractFilmLaw, *others: AbstractFilmLaw
) -> MixedConvection:
    """The law of a mechanism beside those of its neighbours, in their order."""
    return MixedConvection(
        law, others=others, acts=tuple(neighbour.acts for neighbour in neighbours)
    )


def mixed(
    bindings: Sequence[tuple[int, Binding]],
    beside: Mapping[int, Sequence[Beside]],
    law_beside: Callable[..., MixedConvection],
) -> list[tuple[int, Binding]]:
    """Bindings, those of convection with the part that each has beside others.

    Their laws are made as by `mixed_law`.
    """
    parts = list(bindings)
    for place, neighbours in beside.items():
        number, binding = bindings[place]
        others = (_film_law(bindings[n.place][1]) for n in neighbours)
        law = law_beside(neighbours, _film_law(binding), *others)
        parts[place] = number, binding._replace(law=law)
    return parts


def _film_law(binding: Binding) -> AbstractFilmLaw:
    assert isinstance(binding.law, AbstractFilmLaw)
    return binding.law

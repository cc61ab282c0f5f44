"""Irradiation of a surface: what radiative terms bring, absorbed and reflected.

Thermal radiation H and that of sources E [W/m^2] reach a surface at T:

    H = sigma T^4 + sum_n F_n q_n(T),    E = sum_m X_m s_m(t),

with the view factors F and laws q of thermal terms, exposures X and strengths s of
sources. The surface absorbs eps (H - sigma T^4) + a E, which is the heat of these terms
in the balance, and reflects (1 - eps) H + (1 - a) E, which a camera sees beside the
emission eps sigma T^4. What sees nothing that radiates receives as much as it emits.
"""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from ...arrays import Time, is_traced, typed_array
from ...constants import SOLAR_TEMPERATURE, STEFAN_BOLTZMANN
from ...findings import found, is_finding
from ...module import Module
from ...voxels.selection import AbstractSelection
from ..flux_law import AbstractFluxLaw, PerCell
from ..surface import Binding, BodySurface, Cover, Omitted, Surface, concatenated
from ..term import AbstractSurfaceTerm
from ..time_varying import is_zero, value_at


class Irradiation(NamedTuple):
    """Radiation that reaches the fragments of a scene, whether they absorb it or not.

    Of thermal radiation, net of what a black surface emits: the factor times the law's
    flux is H - sigma T^4 [W/m^2].
    """

    factor: Float[np.ndarray, " s"]
    """View factor [-], or the exposure to a source: irradiation by a flux of 1."""
    law: AbstractFluxLaw
    notes: tuple[str, ...] = ()
    """Remarks on the validity of the law, for the receipt."""
    spectrum: Any = SOLAR_TEMPERATURE
    """Temperature of a black body with the spectrum of a source [K]: a number or a
    function of time."""


class AbstractRadiativeTerm(AbstractSurfaceTerm):
    """A mechanism that irradiates surfaces: it heats them, and they reflect the rest.

    Implement `irradiation`; the heat in the balance and the radiation in an image both
    follow from it.
    """

    absorbed_by: ClassVar[str] = "emissivity"
    """Property of a surface that absorbs it: "emissivity" or "absorptivity"."""
    unseen: ClassVar[str] = "no surface of this body sees it"
    """Reason for leaving it out where its factor is 0."""

    @property
    def on(self) -> AbstractSelection | None:
        """Part of the surface that it irradiates; None for all."""
        return None

    @property
    def horizon(self) -> tuple[Any, Any] | None:
        """Temperatures of sky and ground behind all bodies [K]; None of a source."""
        return None

    @abc.abstractmethod
    def irradiation(self, surface: Surface) -> tuple[Irradiation, ...]:
        """Its irradiation of all fragments, whatever else acts there."""

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        return self.absorbed(surface, self.irradiation(surface))

    def absorbed(
        self, surface: Surface, irradiation: tuple[Irradiation, ...]
    ) -> tuple[Binding | Omitted, ...]:
        """The heat that the surface takes from its irradiation."""
        factors = [surface.apart(each.factor) for each in irradiation]
        covers = [
            self._covers(body, [own[n] for own in factors])
            for n, body in enumerate(surface.bodies)
        ]
        omitted = [cover for cover in covers if isinstance(cover, Omitted)]
        if len(omitted) == len(covers):
            return tuple(omitted)
        bindings: list[Binding] = []
        for n, each in enumerate(irradiation):
            own = [c if isinstance(c, Omitted) else c[n] for c in covers]
            (binding, *_) = surface.bind(each.law, own)
            assert isinstance(binding, Binding)
            acts = [bool(part.any()) for part in surface.apart(binding.acts)]
            notes = ((b, note) for note in each.notes for b, a in enumerate(acts) if a)
            if any(acts) or not surface.prune:
                bindings.append(binding._replace(notes=tuple(notes)))
        return (*bindings, *omitted)

    def _covers(
        self, body: BodySurface, factors: list[Float[np.ndarray, " _"]]
    ) -> list[Cover] | Omitted:
        """Absorbing area of a body for each irradiation, times its factor."""
        absorbed = getattr(body, self.absorbed_by)
        if body.prune and is_zero(absorbed):
            return body.omitted(f"the surface has {self.absorbed_by} 0")
        exposed = body.exposed(self.on)
        if isinstance(exposed, Omitted):
            return exposed
        # Fragments out of sight are left out of the binding, so that they cost nothing.
        lit = [_lit(factor, body.area) for factor in factors]
        # Exposed everywhere, the same array in all runs.
        both = lambda reached: reached if exposed.all() else exposed & reached
        covers = [(_times(absorbed, area), both(reached)) for area, reached in lit]
        if body.prune and not any(acts.any() for _, acts in covers):
            return body.omitted(self.unseen)
        return covers

    def _on_all(
        self,
        surface: Surface,
        factors: list[Float[np.ndarray, " _"]],
        law: AbstractFluxLaw,
        notes: tuple[str, ...] = (),
        spectrum: Any = SOLAR_TEMPERATURE,
    ) -> Irradiation:
        """Irradiation of the bodies by the factors of each, where `on` selects them."""
        chosen = [
            factor if self.on is None else factor * body.selected(self.on)
            for body, factor in zip(surface.bodies, factors, strict=True)
        ]
        return Irradiation(
            factor=concatenated(chosen), law=law, notes=notes, spectrum=spectrum
        )


def _lit(
    factor: Float[np.ndarray, " s"], area: Float[np.ndarray, " s"]
) -> tuple[Float[np.ndarray, " s"], Bool[np.ndarray, " s"]]:
    """Area of fragments times a factor [m^2], and those where that is not 0."""
    lit = lambda: (factor.astype(area.dtype) * area, factor > 0)
    return found((factor, area), "lit" if is_finding(factor, area) else None, lit)


def _times(number: Any, area: Float[np.ndarray, " s"]) -> Any:
    """Areas times a number or an array, once for each number."""
    if np.ndim(number) or is_traced(number) or not is_finding(area):
        return number * area
    return found((area,), ("times", float(number)), lambda: number * area)


class _Part(Module):
    """An irradiation in the type of the state."""

    factor: Float[Any, " s"]
    law: AbstractFluxLaw
    spectrum: Any


class Irradiance(NamedTuple):
    """Radiation that reaches every fragment at one time."""

    thermal: Any
    """H, of surroundings and surfaces [W/m^2], [s]."""
    sources: Any
    """E of the sources, in the order of the terms, those never on left out [W/m^2],
    [q s]."""
    spectrum: Any
    """Temperature of a black body with the spectrum of each row [K], [q]."""

    def reflected(self, emissivity: Any, absorptivity: Any) -> tuple[Any, Any]:
        """(1 - eps) H + (1 - a) E of the radiosity, and (1 - a) E [W/m^2]."""
        from_sources = (1 - absorptivity) * self.sources.sum(0)
        return (1 - emissivity) * self.thermal + from_sources, from_sources


class SurfaceRadiation(Module):
    """Irradiation of the fragments of all bodies at one snapshot of a scene."""

    thermal: tuple[_Part, ...]
    sources: tuple[_Part, ...]
    enclosure: Any
    """Radiation between fragments; None if no term brings any."""
    reference: Float[Any, "*#s"]
    """Temperature from which the laws count [K]."""

    def irradiance(self, time: Time, temperature: PerCell) -> Irradiance:
        """Irradiance of surfaces at temperatures [K]."""
        theta = temperature - self.reference
        thermal = [part.law for part in self.thermal]
        if self.enclosure is not None:
            received = self.enclosure.irradiation(time, theta)
            thermal = [law.irradiated(received, True) for law in thermal]
        laws = zip(self.thermal, thermal, strict=True)
        net = sum((part.factor * law.flux(time, theta) for part, law in laws), 0.0)
        black = STEFAN_BOLTZMANN * temperature**4
        rows, spectrum = [], []
        for part in self.sources:
            lit = part.factor * part.law.flux(time, theta)
            rows.append(jnp.broadcast_to(lit, theta.shape))
            kelvin = value_at(part.spectrum, time)
            spectrum.append(jnp.asarray(kelvin, theta.dtype).reshape(()))
        none = jnp.zeros((0, *theta.shape), theta.dtype)
        if not rows:
            return Irradiance(black + net, none, none[:, 0])
        return Irradiance(black + net, jnp.stack(rows), jnp.stack(spectrum))


class SceneRadiation(Module):
    """Irradiation of a scene over time."""

    starts: tuple[float, ...] = eqx.field(static=True)
    """Start of each snapshot [s]."""
    snapshots: tuple[SurfaceRadiation, ...]

    def at(self, time: Time | float) -> SurfaceRadiation:
        """The snapshot at a time [s], which is known if there are several."""
        if len(self.snapshots) == 1:
            return self.snapshots[0]
        # A saved time may be a rounding error before the start of its snapshot.
        started = np.asarray(self.starts) <= float(time) * (1 + 1e-6)
        return self.snapshots[max(int(started.sum()) - 1, 0)]


def surface_radiation(
    surface: Surface,
    irradiation: tuple[tuple[str, Irradiation], ...],
    enclosure: Any,
) -> SurfaceRadiation:
    """Radiation on a surface: each irradiation with the property that absorbs it."""

    def parts(absorbed_by: str) -> tuple[_Part, ...]:
        return tuple(
            _Part(
                typed_array(each.factor, surface.dtype),
                each.law.above(surface.reference),
                each.spectrum,
            )
            for by, each in irradiation
            if by == absorbed_by
        )

    thermal, sources = parts("emissivity"), parts("absorptivity")
    return SurfaceRadiation(
        thermal=thermal,
        sources=sources,
        enclosure=enclosure,
        reference=surface.reference,
    )

"""Irradiation of a surface by radiative terms, absorbed and reflected.

Thermal radiation H and that of sources E [W/m^2] reach a surface at T:

    H = sigma T^4 + sum_n F_n q_n(T),    E = sum_m X_m s_m(t),

with the view factors F and laws q of thermal terms, exposures X and strengths s of
sources. The surface absorbs eps (H - sigma T^4) + a E, which is the heat of these terms
in the balance, and reflects (1 - eps) H + (1 - a) E, which a camera sees in addition to
the emission eps sigma T^4. A surface that sees nothing which radiates receives as much
as it emits.
"""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Float
from typing_extensions import override

from ...arrays import HostTime, Time, typed_array
from ...constants import SOLAR_TEMPERATURE, STEFAN_BOLTZMANN
from ...voxels.selection import AbstractSelection
from ..flux_law import AbstractFluxLaw, PerCell
from ..surface import (
    Binding,
    BodySurface,
    Cover,
    Note,
    Omitted,
    Surface,
    concatenated,
)
from ..term import AbstractSurfaceTerm
from ..time_varying import is_zero, value_at


class Irradiation(NamedTuple):
    """Radiation that reaches the fragments of a scene, whether they absorb it or not.

    Thermal radiation is net of the emission of a black surface: the factor times the
    law's flux is H - sigma T^4 [W/m^2].
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
    """A mechanism that irradiates surfaces, which absorb a part and reflect the rest.

    Implement `irradiation`; the heat in the balance and the radiation in an image both
    follow from it.
    """

    absorbed_by: ClassVar[str] = "emissivity"
    """Property of a surface that absorbs it: "emissivity" or "absorptivity"."""
    unseen: ClassVar[str] = "no surface of this body sees it"
    """Reason for leaving it out where its factor is 0."""
    dark: ClassVar[str] = "it is switched off at all times"
    """Reason for leaving it out where it has no irradiation."""

    @property
    def on(self) -> AbstractSelection | None:
        """Part of the surface that it irradiates; None for all."""
        return None

    @abc.abstractmethod
    def irradiation(self, surface: Surface) -> tuple[Irradiation, ...]:
        """Irradiation of all fragments, whatever other terms act there."""

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        return self.absorbed(surface, self.irradiation(surface))

    def absorbed(
        self, surface: Surface, irradiation: tuple[Irradiation, ...]
    ) -> tuple[Binding | Omitted, ...]:
        """Heat that the surface absorbs of its irradiation."""
        if not irradiation:
            return (Omitted(self.dark),)
        factors = [surface.apart(incident.factor) for incident in irradiation]
        # A method of a module is a new object in each call: one for all bodies.
        covers_of = self._covers
        covers = [
            covers_of(body, [by_body[n] for by_body in factors])
            for n, body in enumerate(surface.bodies)
        ]
        omitted = [cover for cover in covers if isinstance(cover, Omitted)]
        if len(omitted) == len(covers):
            return tuple(omitted)
        bindings: list[Binding] = []
        for n, incident in enumerate(irradiation):
            nth_covers = [c if isinstance(c, Omitted) else c[n] for c in covers]
            (binding, *_) = surface.bind(incident.law, nth_covers)
            assert isinstance(binding, Binding)
            masks = surface.apart(binding.acting)
            lit_bodies = [body for body, mask in enumerate(masks) if mask.any()]
            notes = tuple(
                Note.of_line(body, note)
                for note in incident.notes
                for body in lit_bodies
            )
            if lit_bodies or not surface.prune:
                absorbing = surface.coefficient(self.absorbed_by)
                area = absorbing * binding.effective_area
                bindings.append(binding._replace(effective_area=area, notes=notes))
        return (*bindings, *omitted)

    def _covers(
        self, body: BodySurface, factors: list[Float[np.ndarray, " _"]]
    ) -> list[Cover] | Omitted:
        """Area of a body for each irradiation, times its factor."""
        if body.prune and is_zero(getattr(body, self.absorbed_by)):
            return body.omitted(f"the surface has {self.absorbed_by} 0")
        fraction = None if self.on is None else body.selected_fraction(self.on)
        exposed = body.exposed_of(None if fraction is None else fraction > 0)
        if isinstance(exposed, Omitted):
            return exposed
        # Fragments out of sight are left out of the binding, so that they cost nothing.
        covers = []
        for factor in factors:
            area = factor.astype(body.area.dtype) * body.area
            covers.append((area, exposed & (factor > 0)))
        if body.prune and not any(acting.any() for _, acting in covers):
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
        """Irradiation of the bodies by their factors, where `on` selects surface."""
        selected = [
            factor * body.selected_fraction(self.on)
            if self.on is not None or body.grid.adiabatic is not None
            else factor
            for body, factor in zip(surface.bodies, factors, strict=True)
        ]
        return Irradiation(
            factor=concatenated(selected), law=law, notes=notes, spectrum=spectrum
        )


class _Incident(Module):
    """An irradiation in the type of the state."""

    factor: Float[Any, " s"]
    law: AbstractFluxLaw
    spectrum: Any


class Irradiance(NamedTuple):
    """Radiation that reaches every fragment at one time."""

    thermal: Any
    """H, of surroundings and surfaces [W/m^2], [s]."""
    sources: Any
    """E of the sources that are on at some time, in the order of the terms [W/m^2],
    [q s]."""
    spectrum: Any
    """Temperature of a black body with the spectrum of each row [K], [q]."""

    def reflected(self, emissivity: Any, absorptivity: Any) -> tuple[Any, Any]:
        """(1 - eps) H + (1 - a) E of the radiosity, and (1 - a) E [W/m^2]."""
        from_sources = (1 - absorptivity) * self.sources.sum(0)
        return (1 - emissivity) * self.thermal + from_sources, from_sources


class SurfaceRadiation(Module):
    """Irradiation of the fragments of all bodies at one snapshot of a scene."""

    thermal: tuple[_Incident, ...]
    """Irradiation by surroundings."""
    sources: tuple[_Incident, ...]
    """Irradiation by sources."""
    enclosure: Any
    """Radiation between fragments; None without a term for it."""
    reference: Float[Any, "*#s"]
    """Temperature from which the laws count [K]."""

    def irradiance(self, time: Time, temperature: PerCell) -> Irradiance:
        """Irradiance of surfaces at temperatures [K]."""
        theta = temperature - self.reference
        laws = [incident.law for incident in self.thermal]
        if self.enclosure is not None:
            received = self.enclosure.irradiation(time, theta)
            laws = [law.irradiated(received, emits=True) for law in laws]
        net = 0.0
        for incident, law in zip(self.thermal, laws, strict=True):
            net = net + incident.factor * law.flux(time, theta)
        rows = []
        spectrum = []
        for source in self.sources:
            lit = source.factor * source.law.flux(time, theta)
            rows.append(jnp.broadcast_to(lit, theta.shape))
            kelvin = value_at(source.spectrum, time)
            spectrum.append(jnp.asarray(kelvin, theta.dtype).reshape(()))
        empty = jnp.zeros((0, *theta.shape), theta.dtype)
        return Irradiance(
            thermal=STEFAN_BOLTZMANN * temperature**4 + net,
            sources=jnp.stack(rows) if rows else empty,
            spectrum=jnp.stack(spectrum) if rows else empty[:, 0],
        )


class SceneRadiation(Module):
    """Irradiation of a scene over time."""

    starts: tuple[float, ...] = eqx.field(static=True)
    """Start of each snapshot [s]."""
    snapshots: tuple[SurfaceRadiation, ...]

    def at(self, time: Time | HostTime | float) -> SurfaceRadiation:
        """The snapshot at a time [s], which must not be traced if there are several."""
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

    def incident_on(absorbed_by: str) -> tuple[_Incident, ...]:
        return tuple(
            _Incident(
                factor=typed_array(incident.factor, surface.dtype),
                law=incident.law.above(surface.reference),
                spectrum=incident.spectrum,
            )
            for by, incident in irradiation
            if by == absorbed_by
        )

    return SurfaceRadiation(
        thermal=incident_on("emissivity"),
        sources=incident_on("absorptivity"),
        enclosure=enclosure,
        reference=surface.reference,
    )

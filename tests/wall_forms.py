"""Closed forms of layered walls, of ground, of a room of air, and of a shield.

Layers follow each other from the first surface, at x = 0, in perfect contact.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from jaxthermo.arrays import HostFloat, Quantity, Scalar
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.reference.semi_infinite import host


_TERMS = 80
_HALVINGS = 80


class WallLayer(NamedTuple):
    """A layer of a wall."""

    thickness: float
    """[m]"""
    conductivity: float
    """k [W/(m K)]"""
    capacity: float
    """Volumetric heat capacity rho c [J/(m^3 K)]."""


class Air(NamedTuple):
    """The air at one side of a wall."""

    temperature: float
    """[K]"""
    heat_transfer_coefficient: float
    """Between it and the surface [W/(m^2 K)]."""


class _Through(NamedTuple):
    """Steady heat flow through a wall."""

    transmittance: float
    """U [W/(m^2 K)], heat flux over the difference of the airs."""
    heat_flux: float
    """From the first air to the second [W/m^2]."""
    first_surface: float
    """Temperature of the surface at the first air [K]."""
    second_surface: float
    """Temperature of the surface at the second air [K]."""


def through_wall(first: Air, layers: Sequence[WallLayer], second: Air) -> _Through:
    """Steady heat flow through a wall, and the temperatures of its two surfaces.

    U = 1 / (1 / h_1 + sum_l d_l / k_l + 1 / h_2), q = U (T_1 - T_2)

    Source: ISO 6946.
    """
    resistance = sum(layer.thickness / layer.conductivity for layer in layers)
    resistance += 1 / first.heat_transfer_coefficient
    resistance += 1 / second.heat_transfer_coefficient
    flux = (first.temperature - second.temperature) / resistance
    return _Through(
        transmittance=1 / resistance,
        heat_flux=flux,
        first_surface=first.temperature - flux / first.heat_transfer_coefficient,
        second_surface=second.temperature + flux / second.heat_transfer_coefficient,
    )


def _effusivity(layer: WallLayer) -> float:
    """Thermal effusivity sqrt(k rho c) [W s^0.5/(m^2 K)]."""
    return float(np.sqrt(layer.conductivity * layer.capacity))


def _slowness(layer: WallLayer) -> float:
    """1 / sqrt(alpha) [s^0.5/m]."""
    return float(np.sqrt(layer.capacity / layer.conductivity))


class _Shot(NamedTuple):
    """Waves that obey the condition at the first surface, of given frequencies."""

    size: Float[np.ndarray, "l m"]
    """r of each layer [-]."""
    phase: Float[np.ndarray, "l m"]
    """Phase at the beginning of each layer [rad]."""
    end: Float[np.ndarray, " m"]
    """Phase at the second surface [rad]."""


def _shoot(first: Air, layers: Sequence[WallLayer], frequency: HostFloat) -> _Shot:
    """The waves r sin(phase + w x'/sqrt(alpha)) that start at the first surface."""
    entry = _effusivity(layers[0]) * frequency
    phase = np.arctan2(entry, first.heat_transfer_coefficient)
    size = np.ones_like(frequency)
    phases = []
    sizes = []
    end = phase
    for number, layer in enumerate(layers):
        if number:
            # u and k u' are continuous: r sin(phase) and r e cos(phase).
            ratio = _effusivity(layers[number - 1]) / _effusivity(layer)
            sine = np.sin(end)
            cosine = np.cos(end)
            size = size * np.hypot(sine, ratio * cosine)
            # The phase stays in its quarter of its turn: it changes by less than pi/2.
            across = (1 - ratio) * sine * cosine
            phase = end + np.arctan2(across, ratio * cosine**2 + sine**2)
        phases.append(phase)
        sizes.append(size)
        end = phase + frequency * layer.thickness * _slowness(layer)
    return _Shot(np.array(sizes), np.array(phases), end)


class _Modes(NamedTuple):
    """Eigenfunctions of a wall in layers: u = r sin(phase + w x'/sqrt(alpha))."""

    frequency: Float[np.ndarray, " m"]
    """w, the square roots of the decay rates [1/s^0.5]."""
    waves: _Shot
    norm: Float[np.ndarray, " m"]
    """Integral of rho c u^2 over the wall [J/(m^2 K)]."""


def _modes(first: Air, layers: Sequence[WallLayer], second: Air) -> _Modes:
    """The first eigenfunctions, with k u' = h u, x inwards, at both surfaces."""
    # The phase at the second surface grows with the frequency (Sturm): each root is
    # alone between two multiples of pi, and bisection finds them all.
    target = np.pi * np.arange(1, _TERMS + 1)
    low = np.zeros(_TERMS)
    length = sum(layer.thickness * _slowness(layer) for layer in layers)
    high = (target + np.pi * len(layers)) / length
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        leaving = _effusivity(layers[-1]) * middle
        loss = np.arctan2(leaving, second.heat_transfer_coefficient)
        is_below = _shoot(first, layers, middle).end + loss < target
        low = np.where(is_below, middle, low)
        high = np.where(is_below, high, middle)
    frequency = 0.5 * (low + high)
    waves = _shoot(first, layers, frequency)
    norm = np.zeros(_TERMS)
    for layer, phase, size in zip(layers, waves.phase, waves.size, strict=True):
        number = frequency * _slowness(layer)
        end = phase + number * layer.thickness
        difference = (np.sin(2 * end) - np.sin(2 * phase)) / (4 * number)
        norm += layer.capacity * size**2 * (layer.thickness / 2 - difference)
    return _Modes(frequency, waves, norm)


def layered_wall(
    position: Quantity,
    time: Scalar,
    *,
    initial: Scalar,
    first: Air,
    layers: Sequence[WallLayer],
    second: Air,
) -> HostFloat:
    """Temperature of a layered wall at x [m], from t = 0 between two airs [K].

    T = T_steady(x) + sum_n c_n u_n(x) exp(-w_n^2 t),
    c_n = [h_1 (T_i - T_1) u_n(0) + h_2 (T_i - T_2) u_n(L)] / (w_n^2 N_n)

    The eigenfunctions are u = r sin(phase + w x'/sqrt(alpha)) in each layer, with u and
    k u' continuous, k u' = h_1 u at x = 0 and -k u' = h_2 u at x = L, and N_n is the
    integral of rho c u_n^2. The initial temperature T_i [K] is uniform; at least one of
    the coefficients is above 0; 80 terms resolve times from about 1e-3 L^2/alpha on.
    Source: Hahn and Ozisik, Heat Conduction, one-dimensional composite medium.
    """
    x = host(position)
    edges = np.concatenate([[0.0], np.cumsum([layer.thickness for layer in layers])])
    number = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(layers) - 1)
    modes = _modes(first, layers, second)
    rate = modes.frequency**2
    way = (x - edges[number]) * np.array([_slowness(layer) for layer in layers])[number]
    phase = modes.waves.phase[number] + way[..., None] * modes.frequency
    shape = modes.waves.size[number] * np.sin(phase)
    at_first = np.sin(modes.waves.phase[0])
    at_second = modes.waves.size[-1] * np.sin(modes.waves.end)
    gain = first.heat_transfer_coefficient * (initial - first.temperature) * at_first
    gain = gain + (
        second.heat_transfer_coefficient * (initial - second.temperature) * at_second
    )
    amplitude = gain / (rate * modes.norm) * np.exp(-rate * float(time))
    return np.asarray(_steady_wall(x, first, layers, second) + shape @ amplitude)


def _steady_wall(
    position: HostFloat, first: Air, layers: Sequence[WallLayer], second: Air
) -> HostFloat:
    """Steady temperature at x [K]; a surface with h = 0 passes no heat."""
    coefficients = (first.heat_transfer_coefficient, second.heat_transfer_coefficient)
    if min(coefficients) == 0:
        air = second if first.heat_transfer_coefficient == 0 else first
        return np.full(position.shape, float(air.temperature))
    flow = through_wall(first, layers, second)
    drops = [flow.heat_flux * layer.thickness / layer.conductivity for layer in layers]
    edges = np.cumsum([0.0, *(layer.thickness for layer in layers)])
    corners = flow.first_surface - np.cumsum([0.0, *drops])
    return np.asarray(np.interp(position, edges, corners))


def periodic_ground(
    depth: Quantity,
    *,
    period: Scalar,
    conductivity: Scalar,
    capacity: Scalar,
    thickness: Scalar = np.inf,
    is_held_below: bool = False,
    heat_transfer_coefficient: Scalar = np.inf,
) -> Complex[np.ndarray, "..."]:
    """Response of ground to a periodic air or surface temperature, complex [-].

    The temperature at a depth x [m] is T_m + A |r| cos(w t + arg r) for air of
    T_m + A cos(w t), w = 2 pi / period:

    r = h / (h + k p c) g(x), p = sqrt(i w rho c / k)

    no heat passes x = L: g = cosh(p (L - x))/cosh(p L), c = tanh(p L);
    held at T_m at x = L: g = sinh(p (L - x))/sinh(p L), c = coth(p L);
    L infinite (the default): g = exp(-p x), c = 1.

    At h infinite (the default) A is the amplitude of the surface. `capacity` is rho c
    [J/(m^3 K)]. Source: Carslaw and Jaeger, 2.6 and 3.6.
    """
    x = host(depth)
    frequency = 2j * np.pi / float(period)
    p = np.sqrt(frequency * float(capacity) / float(conductivity))
    mirror = -1.0 if is_held_below else 1.0
    # By decaying exponentials alone, which stay finite at any thickness.
    echo = mirror * np.exp(-2 * p * float(thickness)) if np.isfinite(thickness) else 0.0
    returned = np.zeros_like(x, dtype=complex)
    if np.isfinite(thickness):
        returned = mirror * np.exp(-p * (2 * float(thickness) - x))
    inward = (np.exp(-p * x) + returned) / (1 + echo)
    admittance = float(conductivity) * p * (1 - echo) / (1 + echo)
    coupling = 1.0 / (1.0 + admittance / float(heat_transfer_coefficient))
    return np.asarray(coupling * inward)


class _Room(NamedTuple):
    """Temperatures of a room of air and of its walls."""

    wall: HostFloat
    """[K]"""
    air: HostFloat
    """[K]"""
    time_constants: Float[np.ndarray, "2"]
    """Time constants of both modes, the longer first [s]."""


def room_of_air(
    time: Quantity,
    *,
    initial_wall: Scalar,
    initial_air: Scalar,
    outside: Scalar,
    wall_capacity: Scalar,
    air_capacity: Scalar,
    outer_conductance: Scalar,
    inner_conductance: Scalar,
    ventilation: Scalar,
    heat_rate: Scalar = 0.0,
) -> _Room:
    """Temperatures of uniform walls and of the air that they enclose.

    C_w dT_w/dt = G_o (T_out - T_w) + G_i (T_a - T_w) + Q
    C_a dT_a/dt = G_i (T_w - T_a) + G_v (T_out - T_a)

    Capacities C [J/K], conductances G [W/K], with G_v = n V rho c / 3600 for n air
    changes an hour, and the heat rate Q [W] of the walls. Source: the exponential of
    the matrix of both, by its eigenvectors.
    """
    root = np.sqrt([float(wall_capacity), float(air_capacity)])
    inner = float(inner_conductance)
    matrix = np.array(
        [
            [float(outer_conductance) + inner, -inner],
            [-inner, inner + float(ventilation)],
        ]
    )
    rates, vectors = np.linalg.eigh(matrix / np.outer(root, root))
    steady = np.linalg.solve(matrix, [float(heat_rate), 0.0])
    start = np.array([float(initial_wall), float(initial_air)]) - float(outside)
    amplitude = vectors.T @ (root * (start - steady))
    decay = np.exp(-rates * host(time)[..., None])
    excess = steady + (decay * amplitude) @ vectors.T / root
    return _Room(
        wall=np.asarray(float(outside) + excess[..., 0]),
        air=np.asarray(float(outside) + excess[..., 1]),
        time_constants=1 / rates,
    )


class _Shielded(NamedTuple):
    """Radiation between two plates with a shield between them."""

    heat_flux: float
    """From the hot plate to the cold one [W/m^2]."""
    shield: float
    """Temperature of the shield [K]."""


def between_shielded_plates(
    hot: Scalar,
    cold: Scalar,
    *,
    emissivity_hot: Scalar,
    emissivity_cold: Scalar,
    emissivity_to_hot: Scalar,
    emissivity_to_cold: Scalar,
) -> _Shielded:
    """Heat flux between two infinite plates, and the temperature of a thin shield.

    q = sigma (T_1^4 - T_2^4) / (r_1 + r_2), sigma T_s^4 = sigma T_1^4 - q r_1,
    r_1 = 1 / eps_1 + 1 / eps_s1 - 1, r_2 = 1 / eps_s2 + 1 / eps_2 - 1

    with the emissivities of the shield's faces to the hot and to the cold plate. With
    equal ones the flux is half of `between_plates`. Source: Incropera et al., 13.3.4.
    """
    first = 1 / float(emissivity_hot) + 1 / float(emissivity_to_hot) - 1
    second = 1 / float(emissivity_to_cold) + 1 / float(emissivity_cold) - 1
    emission = STEFAN_BOLTZMANN * float(hot) ** 4
    flux = (emission - STEFAN_BOLTZMANN * float(cold) ** 4) / (first + second)
    shield = ((emission - flux * first) / STEFAN_BOLTZMANN) ** 0.25
    return _Shielded(heat_flux=flux, shield=shield)

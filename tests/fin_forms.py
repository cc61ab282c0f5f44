"""Closed forms of fins, discs and cylinders that lose heat along their whole surface.

The equation is that of `jaxthermo.reference.sheets`.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import i0, i1, k0, k1

from jaxthermo.arrays import HostFloat, Quantity, Scalar
from jaxthermo.reference.semi_infinite import host


_TERMS = 400


def _decay_number(
    sheet_conductance: Scalar, heat_transfer_coefficient: Scalar
) -> float:
    """Reciprocal of the decay length, m = sqrt(h / K) [1/m]."""
    return float(np.sqrt(float(heat_transfer_coefficient) / float(sheet_conductance)))


def fin(
    position: Quantity,
    *,
    length: Scalar,
    sheet_conductance: Scalar,
    heat_transfer_coefficient: Scalar,
) -> HostFloat:
    """Excess temperature of a fin over that of its base [-].

    theta / theta_b = cosh(m (L - x)) / cosh(m L), m = sqrt(h / K)

    at x [m] from the base; no heat passes the tip at x = L. Source: Incropera et al.,
    table 3.4.
    """
    m = _decay_number(sheet_conductance, heat_transfer_coefficient)
    span = float(length)
    return np.asarray(np.cosh(m * (span - host(position))) / np.cosh(m * span))


def fin_heat_rate(
    *,
    length: Scalar,
    width: Scalar,
    sheet_conductance: Scalar,
    heat_transfer_coefficient: Scalar,
) -> float:
    """Conductance from the base of a fin to the air, heat rate over theta_b [W/K].

    G = K w m tanh(m L), m = sqrt(h / K)

    with the width w [m] of the base. Source: Incropera et al., table 3.4.
    """
    m = _decay_number(sheet_conductance, heat_transfer_coefficient)
    strip = float(sheet_conductance) * float(width) * m
    return strip * float(np.tanh(m * float(length)))


def sunlit_cylinder(
    angle: Quantity,
    *,
    radius: Scalar,
    sheet_conductance: Scalar,
    heat_transfer_coefficient: Scalar,
    heat_flux: Scalar,
    time: Scalar = np.inf,
    area_capacity: Scalar = 1.0,
) -> HostFloat:
    """Excess of a cylindrical wall in parallel rays across its axis over the air [K].

    theta = sum_n q_n cos(n phi) (1 - exp(-g_n t / C)) / g_n, g_n = h + K n^2 / R^2

    at the angle phi [rad] from the line that faces the rays; q_n are the cosine terms
    of the absorbed flux q max(cos phi, 0): q_0 = q / pi, q_1 = q / 2 and, for even n,
    q_n = (2 q / pi) (-1)^(n/2 + 1) / (n^2 - 1).
    """
    order = np.concatenate([[0, 1], np.arange(2, 2 * _TERMS, 2)])
    even = order[2:]
    signs = np.where(even % 4 == 2, 1.0, -1.0)
    half_wave = 2 / np.pi * signs / (even**2 - 1)
    share = np.concatenate([[1 / np.pi, 0.5], half_wave])
    spread = float(sheet_conductance) / float(radius) ** 2 * order**2
    loss = float(heat_transfer_coefficient) + spread
    risen = -np.expm1(-loss * float(time) / float(area_capacity))
    amplitude = float(heat_flux) * share * risen / loss
    waves = np.cos(order * host(angle)[..., None])
    return np.asarray(np.sum(amplitude * waves, axis=-1))


def heated_disc(
    distance: Quantity,
    *,
    radius: Scalar,
    heated_radius: Scalar,
    sheet_conductance: Scalar,
    heat_transfer_coefficient: Scalar,
    heat_flux: Scalar,
) -> HostFloat:
    """Excess of a disc that is heated in its middle over the air [K].

    r < a: theta = (q / h) (1 - m a [K_1(m a) - I_1(m a) K_1(m b)/I_1(m b)] I_0(m r))
    r > a: theta = (q / h) m a I_1(m a) [K_0(m r) + I_0(m r) K_1(m b)/I_1(m b)]

    at the distance r [m] from the middle, with the heated radius a and the radius b,
    whose rim passes no heat, and m = sqrt(h / K); I and K with an index are modified
    Bessel functions, so that m b must stay below 700. Source: the annular fin of
    Incropera et al., 3.6.4, joined at r = a with equal temperature and heat flux.
    """
    m = _decay_number(sheet_conductance, heat_transfer_coefficient)
    scale = float(heat_flux) / float(heat_transfer_coefficient)
    edge = m * float(heated_radius)
    rim = m * float(radius)
    from_rim = k1(rim) / i1(rim)
    r = m * host(distance)
    inside = 1 - edge * (k1(edge) - i1(edge) * from_rim) * i0(r)
    # K_0 is infinite in the middle, where the other form holds.
    outside = edge * i1(edge) * (k0(np.maximum(r, edge)) + i0(r) * from_rim)
    return np.asarray(scale * np.where(r < edge, inside, outside))


def junction(
    end_temperature: Sequence[Scalar],
    *,
    length: Sequence[Scalar],
    sheet_conductance: Sequence[Scalar],
    heat_transfer_coefficient: Sequence[Scalar],
) -> float:
    """Excess temperature of the edge in which strips of equal width meet [K].

    theta_J = sum_i (K_i m_i / sinh(m_i L_i)) theta_i / sum_i K_i m_i coth(m_i L_i)

    with the excess theta_i of the far end of each strip [K] and its length L_i [m]. At
    h_i = 0 the factors are K_i / L_i. Source: the heat rates of fins with two given
    ends, whose sum at the edge is 0; Incropera et al., table 3.4.
    """
    conductance = np.asarray(sheet_conductance, float)
    span = np.asarray(length, float)
    loss = np.asarray(heat_transfer_coefficient, float)
    x = span * np.sqrt(loss / conductance)
    has_loss = x > 0
    safe = np.where(has_loss, x, 1.0)
    towards = np.where(has_loss, safe / np.sinh(safe), 1.0)
    away = np.where(has_loss, safe / np.tanh(safe), 1.0)
    weight = conductance / span
    received = weight * towards * np.asarray(end_temperature, float)
    return float(np.sum(received) / np.sum(weight * away))

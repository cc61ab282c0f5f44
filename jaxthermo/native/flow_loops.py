"""Collisions of the lattice Boltzmann flow and its tracer, for numba.

Every population is read from the cell that it comes from. The loops are those of
`collided` and `collided_tracer` in `flow.lattice`.
"""

from typing import NamedTuple

import numba
import numpy as np

from .frame import array_at, extent_at, parallel, serial


@serial
def _drawn(f, y):
    """Rows that arrive in the cells of a row, all of the domain's length."""
    n = f[0].shape[1] - 1
    return (
        f[0][y, 1:n],
        f[1][y, : n - 1],
        f[2][y - 1, 1:n],
        f[3][y, 2:],
        f[4][y + 1, 1:n],
        f[5][y - 1, : n - 1],
        f[6][y - 1, 2:],
        f[7][y + 1, 2:],
        f[8][y + 1, : n - 1],
    )


@serial
def _filled(out, y):
    """Rows to fill."""
    n = out[0].shape[1] - 1
    return (
        out[0][y, 1:n],
        out[1][y, 1:n],
        out[2][y, 1:n],
        out[3][y, 1:n],
        out[4][y, 1:n],
        out[5][y, 1:n],
        out[6][y, 1:n],
        out[7][y, 1:n],
        out[8][y, 1:n],
    )


class _Numbers(NamedTuple):
    """Numbers of a collision, in the type of the populations."""

    even_rate: np.floating
    odd_rate: np.floating
    force_x: np.floating
    force_y: np.floating
    w0: np.floating
    w1: np.floating
    w5: np.floating
    half: np.floating
    unit: np.floating
    three: np.floating
    squared: np.floating
    """9/2, the factor of the squared velocity along a direction."""
    kinetic: np.floating
    """3/2, the factor of the squared speed."""


@serial
def _numbers(values):
    # Constants of Python would make everything double.
    return _Numbers(
        even_rate=values[0],
        odd_rate=values[1],
        force_x=values[2],
        force_y=values[3],
        w0=values[4],
        w1=values[5],
        w5=values[6],
        half=values[7],
        unit=values[8],
        three=values[9],
        squared=values[10],
        kinetic=values[11],
    )


@parallel
def _collide(f, numbers, out):
    s, a, force_x, force_y, w0, w1, w5, half, unit, three, squared, kinetic = _numbers(
        numbers
    )
    # What a force adds along each axis and diagonal.
    push = three * (unit - half * a)
    right = w1 * push * force_x
    up = w1 * push * force_y
    ahead = w5 * push * (force_x + force_y)
    back = w5 * push * (force_y - force_x)
    for y in numba.prange(1, f[0].shape[0] - 1):
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = _drawn(f, y)
        t0, t1, t2, t3, t4, t5, t6, t7, t8 = _filled(out, y)
        for x in range(len(r0)):
            f0 = r0[x]
            f1 = r1[x]
            f2 = r2[x]
            f3 = r3[x]
            f4 = r4[x]
            f5 = r5[x]
            f6 = r6[x]
            f7 = r7[x]
            f8 = r8[x]
            u = (f1 - f3) + ((f5 + f8) - (f6 + f7)) + half * force_x
            v = (f2 - f4) + ((f5 + f6) - (f7 + f8)) + half * force_y
            base = f0 + (f1 + f2) + (f3 + f4) + ((f5 + f8) + (f6 + f7))
            base -= kinetic * (u * u + v * v)
            t0[x] = f0 + s * (w0 * base - f0)
            even = s * (w1 * (base + squared * u * u) - half * (f1 + f3))
            odd = a * (w1 * three * u - half * (f1 - f3)) + right
            t1[x] = f1 + (even + odd)
            t3[x] = f3 + (even - odd)
            even = s * (w1 * (base + squared * v * v) - half * (f2 + f4))
            odd = a * (w1 * three * v - half * (f2 - f4)) + up
            t2[x] = f2 + (even + odd)
            t4[x] = f4 + (even - odd)
            c = u + v
            even = s * (w5 * (base + squared * c * c) - half * (f5 + f7))
            odd = a * (w5 * three * c - half * (f5 - f7)) + ahead
            t5[x] = f5 + (even + odd)
            t7[x] = f7 + (even - odd)
            c = v - u
            even = s * (w5 * (base + squared * c * c) - half * (f6 + f8))
            odd = a * (w5 * three * c - half * (f6 - f8)) + back
            t6[x] = f6 + (even + odd)
            t8[x] = f8 + (even - odd)


@parallel
def _collide_tracer(f, g, numbers, out):
    s, a, _, _, w0, w1, w5, half, unit, three, squared, kinetic = _numbers(numbers)
    for y in numba.prange(1, f[0].shape[0] - 1):
        _, m1, m2, m3, m4, m5, m6, m7, m8 = _drawn(f, y)
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = _drawn(g, y)
        t0, t1, t2, t3, t4, t5, t6, t7, t8 = _filled(out, y)
        u = np.empty_like(r0)
        v = np.empty_like(r0)
        total = np.empty_like(r0)
        # Apart, each loop has few enough arrays to be vectorized.
        for x in range(len(r0)):
            u[x] = (m1[x] - m3[x]) + ((m5[x] + m8[x]) - (m6[x] + m7[x]))
            v[x] = (m2[x] - m4[x]) + ((m5[x] + m6[x]) - (m7[x] + m8[x]))
        for x in range(len(r0)):
            straight = (r1[x] + r2[x]) + (r3[x] + r4[x])
            total[x] = r0[x] + straight + ((r5[x] + r8[x]) + (r6[x] + r7[x]))
        for x in range(len(r0)):
            f0 = r0[x]
            f1 = r1[x]
            f2 = r2[x]
            f3 = r3[x]
            f4 = r4[x]
            scale = squared * total[x]
            base = u[x] * u[x] + v[x] * v[x]
            base = total[x] * (unit - kinetic * base)
            t0[x] = f0 + s * (w0 * base - f0)
            even = s * (w1 * (base + scale * u[x] * u[x]) - half * (f1 + f3))
            odd = a * (w1 * three * total[x] * u[x] - half * (f1 - f3))
            t1[x] = f1 + (even + odd)
            t3[x] = f3 + (even - odd)
            even = s * (w1 * (base + scale * v[x] * v[x]) - half * (f2 + f4))
            odd = a * (w1 * three * total[x] * v[x] - half * (f2 - f4))
            t2[x] = f2 + (even + odd)
            t4[x] = f4 + (even - odd)
        for x in range(len(r0)):
            f5 = r5[x]
            f6 = r6[x]
            f7 = r7[x]
            f8 = r8[x]
            scale = squared * total[x]
            base = u[x] * u[x] + v[x] * v[x]
            base = total[x] * (unit - kinetic * base)
            c = u[x] + v[x]
            even = s * (w5 * (base + scale * c * c) - half * (f5 + f7))
            odd = a * (w5 * three * total[x] * c - half * (f5 - f7))
            t5[x] = f5 + (even + odd)
            t7[x] = f7 + (even - odd)
            c = v[x] - u[x]
            even = s * (w5 * (base + scale * c * c) - half * (f6 + f8))
            odd = a * (w5 * three * total[x] * c - half * (f6 - f8))
            t6[x] = f6 + (even + odd)
            t8[x] = f8 + (even - odd)


@serial
def _nine(addresses, first, like):
    """Nine populations of one shape, from a place in a list of XLA on."""
    shape = extent_at(addresses, first, 0), extent_at(addresses, first, 1)
    return (
        array_at(addresses, first, like).reshape(shape),
        array_at(addresses, first + 1, like).reshape(shape),
        array_at(addresses, first + 2, like).reshape(shape),
        array_at(addresses, first + 3, like).reshape(shape),
        array_at(addresses, first + 4, like).reshape(shape),
        array_at(addresses, first + 5, like).reshape(shape),
        array_at(addresses, first + 6, like).reshape(shape),
        array_at(addresses, first + 7, like).reshape(shape),
        array_at(addresses, first + 8, like).reshape(shape),
    )


@serial
def collide(args, results, like):
    """Populations of a flow after a collision."""
    numbers = array_at(args, 0, like)
    f = _nine(args, 1, like)
    _collide(f, numbers, _nine(results, 0, like))


@serial
def collide_both(args, results, like):
    """Populations of a flow and of a tracer in it after a collision."""
    rates = array_at(args, 0, like)
    tracer = array_at(args, 1, like)
    f = _nine(args, 2, like)
    g = _nine(args, 11, like)
    _collide(f, rates, _nine(results, 0, like))
    _collide_tracer(f, g=g, numbers=tracer, out=_nine(results, 9, like))

"""Collisions of the lattice Boltzmann flow and its tracer, for numba.

Every population is drawn from the cell that it comes from; see `flow.lattice`, whose
functions `collided` and `collided_tracer` these are.
"""

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


@serial
def _constants(numbers):
    # In the type of the populations: with one of Python all would become double.
    return numbers[7], numbers[8], numbers[9], numbers[10], numbers[11]


@parallel
def _collide(f, numbers, out):
    s, a, force_x, force_y = numbers[0], numbers[1], numbers[2], numbers[3]
    w0, w1, w5 = numbers[4], numbers[5], numbers[6]
    half, one, three, squared, own = _constants(numbers)
    # What a force adds along each axis and diagonal.
    push = three * (one - half * a)
    right, up = w1 * push * force_x, w1 * push * force_y
    ahead, back = w5 * push * (force_x + force_y), w5 * push * (force_y - force_x)
    for y in numba.prange(1, f[0].shape[0] - 1):
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = _drawn(f, y)
        t0, t1, t2, t3, t4, t5, t6, t7, t8 = _filled(out, y)
        for x in range(len(r0)):
            f0, f1, f2, f3, f4 = r0[x], r1[x], r2[x], r3[x], r4[x]
            f5, f6, f7, f8 = r5[x], r6[x], r7[x], r8[x]
            u = (f1 - f3) + ((f5 + f8) - (f6 + f7)) + half * force_x
            v = (f2 - f4) + ((f5 + f6) - (f7 + f8)) + half * force_y
            base = f0 + (f1 + f2) + (f3 + f4) + ((f5 + f8) + (f6 + f7))
            base -= own * (u * u + v * v)
            t0[x] = f0 + s * (w0 * base - f0)
            even = s * (w1 * (base + squared * u * u) - half * (f1 + f3))
            odd = a * (w1 * three * u - half * (f1 - f3)) + right
            t1[x], t3[x] = f1 + (even + odd), f3 + (even - odd)
            even = s * (w1 * (base + squared * v * v) - half * (f2 + f4))
            odd = a * (w1 * three * v - half * (f2 - f4)) + up
            t2[x], t4[x] = f2 + (even + odd), f4 + (even - odd)
            c = u + v
            even = s * (w5 * (base + squared * c * c) - half * (f5 + f7))
            odd = a * (w5 * three * c - half * (f5 - f7)) + ahead
            t5[x], t7[x] = f5 + (even + odd), f7 + (even - odd)
            c = v - u
            even = s * (w5 * (base + squared * c * c) - half * (f6 + f8))
            odd = a * (w5 * three * c - half * (f6 - f8)) + back
            t6[x], t8[x] = f6 + (even + odd), f8 + (even - odd)


@parallel
def _collide_tracer(f, g, numbers, out):
    s, a, w0, w1, w5 = numbers[0], numbers[1], numbers[4], numbers[5], numbers[6]
    half, one, three, squared, own = _constants(numbers)
    for y in numba.prange(1, f[0].shape[0] - 1):
        _, m1, m2, m3, m4, m5, m6, m7, m8 = _drawn(f, y)
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = _drawn(g, y)
        t0, t1, t2, t3, t4, t5, t6, t7, t8 = _filled(out, y)
        u, v, total = np.empty_like(r0), np.empty_like(r0), np.empty_like(r0)
        # Apart, each loop has few enough arrays to be vectorized.
        for x in range(len(r0)):
            u[x] = (m1[x] - m3[x]) + ((m5[x] + m8[x]) - (m6[x] + m7[x]))
            v[x] = (m2[x] - m4[x]) + ((m5[x] + m6[x]) - (m7[x] + m8[x]))
        for x in range(len(r0)):
            straight = (r1[x] + r2[x]) + (r3[x] + r4[x])
            total[x] = r0[x] + straight + ((r5[x] + r8[x]) + (r6[x] + r7[x]))
        for x in range(len(r0)):
            f0, f1, f2, f3, f4 = r0[x], r1[x], r2[x], r3[x], r4[x]
            more, base = squared * total[x], u[x] * u[x] + v[x] * v[x]
            base = total[x] * (one - own * base)
            t0[x] = f0 + s * (w0 * base - f0)
            even = s * (w1 * (base + more * u[x] * u[x]) - half * (f1 + f3))
            odd = a * (w1 * three * total[x] * u[x] - half * (f1 - f3))
            t1[x], t3[x] = f1 + (even + odd), f3 + (even - odd)
            even = s * (w1 * (base + more * v[x] * v[x]) - half * (f2 + f4))
            odd = a * (w1 * three * total[x] * v[x] - half * (f2 - f4))
            t2[x], t4[x] = f2 + (even + odd), f4 + (even - odd)
        for x in range(len(r0)):
            f5, f6, f7, f8 = r5[x], r6[x], r7[x], r8[x]
            more, base = squared * total[x], u[x] * u[x] + v[x] * v[x]
            base = total[x] * (one - own * base)
            c = u[x] + v[x]
            even = s * (w5 * (base + more * c * c) - half * (f5 + f7))
            odd = a * (w5 * three * total[x] * c - half * (f5 - f7))
            t5[x], t7[x] = f5 + (even + odd), f7 + (even - odd)
            c = v[x] - u[x]
            even = s * (w5 * (base + more * c * c) - half * (f6 + f8))
            odd = a * (w5 * three * total[x] * c - half * (f6 - f8))
            t6[x], t8[x] = f6 + (even + odd), f8 + (even - odd)


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
    numbers, f = array_at(args, 0, like), _nine(args, 1, like)
    _collide(f, numbers, _nine(results, 0, like))


@serial
def collide_both(args, results, like):
    """The same of a flow and of a tracer in it."""
    rates, tracer = array_at(args, 0, like), array_at(args, 1, like)
    f, g = _nine(args, 2, like), _nine(args, 11, like)
    _collide(f, rates, _nine(results, 0, like))
    _collide_tracer(f, g=g, numbers=tracer, out=_nine(results, 9, like))

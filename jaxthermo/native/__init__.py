"""Loops that numba compiles, called from programs of XLA on a CPU, behind an extra.

`frame` and the modules named `*_loops` import numba, and are imported where a loop is
first called.
"""

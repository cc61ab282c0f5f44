"""Explicit time integration schemes: Euler and super time stepping."""

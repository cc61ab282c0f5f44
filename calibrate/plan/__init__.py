"""The cheapest model of a scene within a tolerance: pitch, structure, solver, steps."""

"""Random realistic scenes: energy, bounds and the stated error in time."""

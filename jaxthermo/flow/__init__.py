"""Flow of air around a body in a plane: the lattice Boltzmann method (thesis 6.2)."""

"""Meshes: files, units, repair, verdict, and procedural shapes."""

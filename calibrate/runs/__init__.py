"""Cases of a scene: run, judged by a reference of finer voxels, timed."""

"""A study: errors and run times of many choices of a scene, and their front."""

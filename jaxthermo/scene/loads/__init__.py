"""Heat loads on the surface of a scene, in general and in linear form."""

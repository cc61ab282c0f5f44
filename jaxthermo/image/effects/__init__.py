"""Effects between a surface and the numbers of a thermal camera, each of its own."""

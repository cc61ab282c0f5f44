"""The conduction operators: dense stencil and sorted links."""

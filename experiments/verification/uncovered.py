"""Published cases that are not computed here, and why."""

NOT_COVERED = (
    (
        "A15, other correlations",
        "Zukauskas, Fand, McAdams, Whitaker and Perkins-Leppert are not among the "
        "averages here",
    ),
    (
        "A15, spectral radiance",
        "images are total radiance; there is no spectrum yet",
    ),
    ("A16", "a camera's chain from raw counts (FLIR) is not here yet"),
    ("A17, angles", "emissivity does not depend on the angle it is seen at"),
    ("A18", "air flow is not computed (lattice Boltzmann); a wake is a formula"),
    ("V24, plates as bodies", "no body is endless; the spheres are computed"),
)
"""Name, and why."""

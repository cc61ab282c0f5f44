"""The 27 claims of the thesis, in our own words."""

from typing import NamedTuple


class Claim(NamedTuple):
    """A statement that can be measured."""

    id: str
    text: str
    place: str
    """Section, table or figure of the thesis."""


CLAIMS = tuple(
    Claim(*row)
    for row in (
        (
            "C01",
            "31.15 W/m² onto one face of a cube of 1 m³ heats twelve materials at the "
            "rates of table 5.1",
            "5.1, table 5.1",
        ),
        ("C02", "a body 100 K warmer sends 31.15 W/m² over 10 m", "5.1"),
        ("C03", "radiation from other bodies than sources can be left out", "5.1"),
        ("C04", "shadow map and cosine give the irradiance of a source", "5.1, eq. 3"),
        (
            "C05",
            "a cube of side n has n² log n cells in irregular levels, n³ in full",
            "6.1",
        ),
        ("C06", "the structures keep 10 to 25 % of the voxels", "3; 6.3"),
        (
            "C07",
            "multi-level costs nearly as much as the full volume",
            "6.3, table 6.1",
        ),
        (
            "C08",
            "irregular levels and shell are 2.6 and 4.2 times faster than the full "
            "volume (1.5 times, says the text of the irregular one)",
            "6.3, table 6.1",
        ),
        (
            "C09",
            "peeling along three axes and keeping the largest normal component stores "
            "each piece of surface once",
            "4.1; 4.2",
        ),
        ("C10", "packing halves the number of layers", "4.2, figure 4.6"),
        (
            "C11",
            "in equilibrium the mean energy is the full volume's, as the same volume "
            "is filled",
            "5.2",
        ),
        (
            "C12",
            "heat takes the long way round in a shell, less so in levels, which "
            "distorts the transient",
            "5.2, figures 5.1 and 5.2",
        ),
        ("C13", "the more levels, the more precise", "6.1, figure 6.1"),
        ("C14", "holes inside distort thick parts, as at the sleeves", "6.1"),
        (
            "C15",
            "irregular cells overlap and leave cracks, so that the heat capacity is "
            "too large or too small in places",
            "6.1, figures 6.2 and 6.3",
        ),
        (
            "C16",
            "tuned conduction weights bring a structure near the full volume",
            "5.2",
        ),
        ("C17", "bodies in contact exchange heat over the touching texels", "5.3"),
        (
            "C18",
            "contacts are found on the surface voxels alone, within a threshold of "
            "depth",
            "5.3, figure 5.3",
        ),
        ("C19", "a broad phase leaves out the pairs that do not touch", "5.3"),
        (
            "C20",
            "the local Nusselt number of a cylinder in cross-flow gives the "
            "convection of a surface",
            "5.4, figure 5.6",
        ),
        ("C21", "wind cools a body differently by its normal", "5.4, figure 5.8"),
        ("C22", "the wake is longer in a wider pipe", "6.2, figure 6.4"),
        (
            "C23",
            "normalized wakes of four wind speeds are one curve",
            "6.2, figures 6.6 and 6.7",
        ),
        ("C24", "the wake is a convergent function of the distance", "6.2, figure 6.5"),
        (
            "C25",
            "the thermal image is stored heat and reflected radiation together",
            "1.3; 5.1; 7",
        ),
        (
            "C26",
            "the simpler Max Planck has fewer layers and voxels than the Happy Buddha "
            "and is faster",
            "6.3, figures 6.8 to 6.11",
        ),
        ("C27", "the simulation runs in real time", "title; 6.3"),
    )
)

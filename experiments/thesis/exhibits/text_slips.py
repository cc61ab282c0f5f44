"""Statements of the thesis' text that do not fit, with a number that decides each."""

from typing import NamedTuple

from jaxthermo.report.numbers import significant
from jaxthermo.report.table import Cell, Table

from .. import slips
from ..exhibit import Exhibit, Finding, Note, Verdict
from ..heated import END


class _Slip(NamedTuple):
    place: str
    words: str
    """The thesis', in short."""
    fits: str
    """The state of things."""
    number: str = ""
    """Computed here; empty where words decide."""


# Numbers in the text, and what they mean.
_REFERENCES = {
    "Equation 6 (5.4, of Nusselt)": "equation 7",
    "Figure 6.3 (6.2, pipe; and its (b), (d))": "figure 6.4",
    "Figure 6.4 (6.2, function)": "figure 6.5",
    "Figure 6.5 (6.2, speeds)": "figure 6.6",
    "Figure 6.6 (6.2, normalized)": "figure 6.7",
    "Figure 6.3 (caption of 6.7)": "figures 6.4 and 6.6",
    "Table 6.2 (6.3)": "table 6.1; there is no 6.2",
    "Figures 6.7 and 6.8 (6.3)": "figures 6.8 and 6.9",
    "Figures 6.9 and 6.10 (6.3)": "figures 6.10 and 6.11",
}
# Iterations of figures 6.1 and 6.3, and the height of a voxel of table 6.1 in a statue
# of half a metre [m].
_ITERATIONS, _VOXEL = (3600, 4000), 0.5 / 550


def _physics() -> list[_Slip]:
    loss, sheet, flows = slips.emission(), slips.thin_sheet(), slips.transition()
    element = slips.element_weights()
    sun, square = slips.sun_at_the_earth(), slips.compressibility()
    return [
        _Slip(
            "1.2; 2",
            "molecular dynamics is the accepted means for conduction; a finite volume "
            "paper is among its examples",
            "MD counts atoms. The thesis' scheme is one of finite volumes.",
            f"{slips.atoms_in_a_voxel(_VOXEL):.1e} atoms in a voxel of copper",
        ),
        _Slip(
            "abstract; 1.3; 7",
            "finite element method",
            "Equation 4 is that of finite volumes. Linear elements on cubes do not "
            "even couple neighbours by their faces.",
            f"face {abs(element['face']):.3f}, edge {element['edge']:.3f}, corner "
            f"{element['corner']:.3f}, where equation 4 has 1, 0, 0",
        ),
        _Slip(
            "1.2",
            "the lattice Boltzmann method does not support incompressible flow such "
            "as gas",
            "It is made for nearly incompressible flow, and 6.2 uses it for wind; what "
            "it cannot do is a large Mach number.",
            f"error by compression, Mach number squared, up to {square:.2%} here",
        ),
        _Slip(
            "5.1",
            "a sun of 5800 K gives about 1000 W/m²",
            "1000 W/m² reach the ground below a clear sky: the air takes the rest, "
            "which no equation has.",
            f"{sun:.0f} W/m² above the air",
        ),
        _Slip(
            "5.1, equation 1",
            "a body radiates σ ε T⁴",
            "It also absorbs what its surroundings send: as warm as they are, it loses "
            "nothing. Equation 1 has no such term and would cool everything.",
            f"{loss['by_equation_1']:.0f} W/m² lost at 300 K; with surroundings "
            f"{abs(loss['with_surroundings']):.0f}",
        ),
        _Slip(
            "5.1",
            "what other objects emit can be omitted",
            "Not what a body emits itself: its loss for a kelvin of excess is of the "
            "order of the wind's, that of 1 m/s on a cylinder of 0.1 m.",
            f"{loss['radiation_per_kelvin']:.2g} beside "
            f"{loss['wind_per_kelvin']:.2g} W/(m² K)",
        ),
        _Slip(
            "5.1, table 5.1",
            "temperatures may change by close to zero",
            "Of solid cubes of 1 m³. The thesis' own shells and thin parts warm as "
            "much faster as they are thinner.",
            f"aluminium: cube {sheet['cube']:.2g}, sheet of 1 mm "
            f"{sheet['sheet_of_1_mm']:.2g} K/s",
        ),
        _Slip(
            "5.1, equation 3",
            "k_d, the diffuse reflection constant, scales what a surface gains",
            "What is gained is absorbed, not reflected. A black body as in table 5.1 "
            "has reflectance 1 - ε.",
            f"k_d = {1 - 1.0:g} for ε = 1: no gain at all",
        ),
        _Slip(
            "5.2, equation 4",
            "q is the heat and ΔT the variation of temperature",
            "q is in W, unlike q in W/m² of equations 1, 5 and 8; ΔT is a difference "
            "between two places, not a change over time.",
        ),
        _Slip(
            "5.2",
            "k should be increased with the size of voxels",
            "k A / L grows with the size by itself. Only the links between two sizes, "
            "whose centres are offset, need a weight.",
            f"conductance from level 1 to 2, k unchanged: times "
            f"{slips.growth_of_conductance():.3g}",
        ),
        _Slip(
            "5.4",
            "equations 5 to 8; each single object with laminar flow",
            "Equation 8 follows from 5 and 7. But two minima of the local number are "
            "the sign of a boundary layer that becomes turbulent.",
            f"equations to {slips.consistency_of_5_to_8():.0e}; "
            f"{flows['minima_at_the_highest']:.0f} minima at Re "
            f"{flows['highest']:.3g}, from Re {flows['two_minima_from']:.3g} on",
        ),
        _Slip(
            "5.4, figure 5.6; 6.2",
            "curves of Re 7e4 to 2.2e5 for winds of 0.2 to 1 m/s",
            "They are of faster winds. On a cylinder of 0.1 m:",
            f"1 m/s has Re {flows['reynolds_of_6_2']:,.0f}; the lowest curve needs "
            f"{flows['lowest_wind_m_s']:.0f} m/s",
        ),
    ]


def _counts() -> list[_Slip]:
    table = slips.table_6_1()
    few, many = (END * n / _ITERATIONS[0] for n in _ITERATIONS)
    return [
        _Slip(
            "6.1; table 6.1",
            "n² log n voxels in irregular levels",
            "Not the table's: 2.8e7 are a cube of side n, with fewer voxels by the "
            "formula than it has, whatever shape the statue is.",
            f"n = {table['side_of_a_cube_as_large']:.0f}, n² log₂ n = "
            f"{table['n2_log2_n']:.2g}; the table has "
            f"{table['irregular_over_n2_log2_n']:.2g} times as many",
        ),
        _Slip(
            "6.3, table 6.1",
            "fewer voxels, less time",
            "By far less than in proportion: a voxel in layers of textures costs more "
            "than one of a full volume.",
            f"{table['fewer_voxels']:.2g} times fewer, {table['times_faster']:.2g} "
            f"times faster; per voxel {table['irregular_ns']:.2g} ns irregular, "
            f"{table['shell_ns']:.2g} shell, {table['multi_level_ns']:.2g} "
            f"multi-level, {table['full_volume_ns']:.2g} full",
        ),
        _Slip(
            "3; 6.1",
            "from O(n³) to O(n² log n)",
            "In chapter 3 of convection by cylinders, in 6.1 of voxels for conduction: "
            "one order for two things (see section-3-growth).",
        ),
        _Slip(
            "6.1, figures 6.1 and 6.3",
            "3600 and 4000 iterations",
            "Neither has a step in seconds, so that the two do not show one time. With "
            "the step that makes 3600 of them the 180 s of figure 5.2:",
            f"{few:.0f} and {many:.0f} s",
        ),
        _Slip(
            "5.2, figure 5.2",
            "multi-level (caption), irregular multi-level (text)",
            "Two structures; which of them the middle is, the thesis leaves open.",
        ),
        _Slip(
            "5.4; 6.2; 6.3",
            "; ".join(_REFERENCES),
            "; ".join(_REFERENCES.values()),
            f"{len(_REFERENCES)} references to another number than meant",
        ),
    ]


def _measure(_: bool) -> Finding:
    found = [*_physics(), *_counts()]
    lines = [
        [each.place, *(Cell(text, wraps=True) for text in each[1:])] for each in found
    ]
    columns = ("place", "the thesis", "what is so", "computed here")
    table = slips.table_6_1()
    with_number = [each for each in found if each.number]
    reason = (
        f"{len(found)} statements that contradict another one, an equation or a "
        f"table, {len(with_number)} of them by a number. The heaviest: equation 1 has "
        f"no surroundings, {slips.emission()['by_equation_1']:.0f} W/m² that a body "
        "as warm as they are would lose; the voxels of table 6.1 are "
        f"{significant(table['irregular_over_n2_log2_n'])} times those of the formula "
        "beside it; and figure 5.6 begins at winds of "
        f"{slips.transition()['lowest_wind_m_s']:.0f} m/s. None changes a result of "
        "another exhibit, each of which says what it takes."
    )
    parts = (
        Table(columns, lines, left=range(len(columns))),
        Note("Slips that another exhibit measures are there, not here."),
    )
    numbers = {
        "slips": [each._asdict() for each in found],
        "emission": slips.emission(),
        "table_6_1": table,
        "transition": slips.transition(),
    }
    return Finding(Verdict.CONTRADICTED, reason, parts=parts, numbers=numbers)


EXHIBIT = Exhibit(
    name="text-slips",
    title="statements that do not fit",
    place="7, and others",
    claims=(),
    measure=_measure,
)

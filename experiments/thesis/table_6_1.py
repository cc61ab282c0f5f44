"""Table 6.1: voxels of the Happy Buddha at 225 x 550 x 225, and times of a step.

The thesis does not say how many levels its multi-level structure has: here it has ten.
"""

FULL = "full volume"
SHELL = "single shell"
IRREGULAR = "irregular levels"
TEN = "ten levels"

KINDS = {
    SHELL: "single_shell",
    IRREGULAR: "irregular_multi_level",
    TEN: "multi_level",
    FULL: "full_volume",
}
"""Kinds of structures in a config."""
TABLE_VOXELS = {SHELL: 2.5e6, IRREGULAR: 3.2e6, TEN: 2.8e7, FULL: 2.8e7}
"""Numbers of voxels; the full volume is the whole box, the empty cells too."""
TABLE_TIMES = {SHELL: 13e-3, IRREGULAR: 21e-3, TEN: 50e-3, FULL: 55e-3}
"""Time of one step of each structure, on an NVIDIA 9800 GT [s]."""
TABLE_HEIGHT = 550
"""Voxels along up."""

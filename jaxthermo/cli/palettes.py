"""`jaxthermo palettes`: the colour scales and the differences between their colours."""

from ..console.terminal import open_console, print_line
from ..image.colour.palette_design import palette_report
from ..report.table import Table


_COLUMNS = {
    "step_min": "smallest\nstep",
    "step_max": "largest\nstep",
    "apart_normal": "normal\nvision",
    "apart_protanopia": "prot-\nanopia",
    "apart_deuteranopia": "deuter-\nanopia",
    "apart_tritanopia": "trit-\nanopia",
}
_NOTE = (
    "CIEDE2000 differences of neighbouring colours (step), and the smallest difference "
    "of two colours at least 1/8 of the scale apart, in normal vision and without one "
    "kind of cone. Below about 1 two temperatures look the same."
)


def palettes() -> None:
    """Print the differences between the colours of every palette."""
    rows = [
        (name, *(f"{facts[key]:.2f}" for key in _COLUMNS))
        for name, facts in palette_report().items()
    ]
    console = open_console()
    console.print(Table(("palette", *_COLUMNS.values()), rows, framed=False).rich())
    print_line(console, _NOTE)

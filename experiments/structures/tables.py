"""The table on the terminal."""

from rich import box
from rich.console import Console
from rich.table import Table

from .summary import Line


COLUMNS = ("structure", "nodes", "run", "times faster", "error %")
MORE = ("steps", "p99 %", "max %", "frame K", "SSIM", "capacity")
NAMES = {
    "error_percent": "error %",
    "nodes": "nodes",
    "node_share": "nodes a solid voxel",
    "times_faster": "times faster",
}
WIDE = 140
"""Characters that all columns take."""


def show_table(console: Console, lines: list[Line]) -> None:
    """One table a body, and below it what was expected and not met."""
    # Wide in a file; on a narrow terminal the columns that matter most.
    wide = not console.is_terminal or console.width >= WIDE
    page = console if console.is_terminal else Console(width=WIDE, markup=False)
    for body in dict.fromkeys(line["body"] for line in lines):
        here = [line for line in lines if line["body"] == body]
        title = f"{body}: worst of all loads and saved times; median times"
        table = Table(title=title, box=box.SIMPLE)
        for name in COLUMNS + (MORE if wide else ()):
            left = name == COLUMNS[0]
            table.add_column(name, justify="left" if left else "right", no_wrap=True)
        for line in here:
            table.add_row(*cells(line, wide))
        page.print(table)
        for line in here:
            for check in line.get("expected", ()):
                if not check["met"]:
                    page.print(f"not met by {line['label']}: {in_words(check)}")


def cells(line: Line, wide: bool) -> list[str]:
    """A line of the table as text."""
    if "refused" in line:
        return [line["label"], "refused"]
    few = [
        line["label"],
        f"{line['nodes']:,}",
        seconds(line["run_time_s"]["median"]),
        times(line["times_faster"]),
        f"{line['worst_rms_percent']:.3g}",
    ]
    more = [
        str(line["steps"]),
        f"{line['worst_p99_percent']:.3g}",
        f"{line['worst_max_percent']:.3g}",
        f"{line['frame_rms_kelvin']:.2g}",
        f"{line['frame_ssim']:.4f}",
        f"{line['capacity_ratio']:.4g}",
    ]
    return few + more if wide else few


def seconds(value: float) -> str:
    """A time for people: "13 ms", "1.92 s", "1085 s"."""
    return f"{plain(value)} s" if value >= 1 else f"{plain(1e3 * value)} ms"


def span(time: dict[str, float]) -> str:
    """A time with its spread in one unit: "13 (12-15) ms"."""
    scale, unit = (1.0, "s") if time["median"] >= 1 else (1e3, "ms")
    median, least, most = (
        plain(scale * time[k]) for k in ("median", "fastest", "slowest")
    )
    return f"{median} ({least}-{most}) {unit}"


def times(ratio: dict[str, float]) -> str:
    """A ratio with its spread: "8.1 (7.5-9.0)"."""
    median, least, most = (plain(ratio[k]) for k in ("median", "least", "most"))
    return f"{median} ({least}-{most})"


def plain(value: float | int) -> str:
    """Three digits, or all before the point: "0.405", "87,947"."""
    return f"{value:,.0f}" if abs(value) >= 999.5 else f"{value:.3g}"


def in_words(check: dict) -> str:
    """What was found and expected: "error % 0.41 (at most 0.3)"."""
    way = "at_most" if "at_most" in check else "at_least"
    name, found, limit = NAMES[check["what"]], check["found"], check[way]
    return f"{name} {plain(found)} ({way.replace('_', ' ')} {plain(limit)})"

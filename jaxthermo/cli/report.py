"""A run told on the terminal: what goes into it, and what came of it."""

import math
import re
from typing import Any

from rich.console import Console
from rich.table import Table

from ..constants import ZERO_CELSIUS
from ..geometry.mesh import mesh_summary
from ..image.ticks import time_label
from ..integrate.implicit.adaptive import AdaptiveStepper
from ..integrate.run.plan import Plan
from ..integrate.run.solution import Solution
from ..memory import readable_bytes
from ..scene.scene import Scene
from .console import tell
from .summary import peak_memory


KEPT = 1e-6
"""A capacity ratio this close to 1 is nothing to speak of."""


def tell_scene(
    console: Console, scene: Scene, todo: Plan, structures: list[dict[str, Any]]
) -> None:
    """The bodies, the receipt, and how many steps there will be.

    Args:
        console: to tell it on.
        scene: what is simulated.
        todo: how.
        structures: the report of each body's.
    """
    for body, report in zip(scene.bodies, structures, strict=True):
        grid = body.structure.grid
        shape = " x ".join(str(n) for n in grid.lattice.shape)
        tell(console, mesh_summary(grid.mesh))
        tell(
            console,
            f"  {grid.solid_count} solid voxels of {grid.pitch * 1e3:.4g} mm in "
            f"{shape}, {len(grid.fragment_area)} surface fragments",
        )
        for line in structure_lines(report):
            tell(console, f"  {line}")
    receipt = todo.compiled.receipt
    tell(console, f"included: {', '.join(receipt.included)}")
    for omission in receipt.left_out:
        tell(console, f"left out: {omission.what} ({omission.why})")
    for note in receipt.notes:
        tell(console, f"note: {note}")
    limit = "none" if todo.stable_step is None else f"{todo.stable_step:.4g} s"
    steps = f"{todo.steps} steps"
    if isinstance(todo.stepper, AdaptiveStepper):
        steps = f"steps that follow the error, to {todo.steps} landings"
    tell(
        console,
        f"{type(todo.solver).__name__} ({todo.solver_reason}): {steps}, stable step "
        f"{limit}, about {readable_bytes(receipt.memory_bytes)} for the solver",
    )


def tell_receipt(console: Console, scene: Scene, todo: Plan) -> None:
    """All of the receipt: what acts where, what is left out, what it will take.

    Args:
        console: to tell it on.
        scene: what would be simulated.
        todo: how.
    """
    receipt = todo.compiled.receipt
    table = Table(box=None, pad_edge=False, title_justify="left")
    for title in ("mechanism", "on", "area", "of the surface"):
        table.add_column(
            title, justify="left" if title in ("mechanism", "on") else "right"
        )
    for index, body in enumerate(scene.bodies):
        kind = type(body.structure).__name__
        table.add_row("conduction", f"body {index} ({kind})", "", "")
    for part in receipt.parts:
        where = " and ".join(f"body {index}" for index in part.bodies)
        if part.area:
            share = f"{100 * part.surface_share:.3g} %"
            table.add_row(part.mechanism, where, f"{part.area:.4g} m2", share)
        else:
            table.add_row(part.mechanism, where, "inside", "")
    console.print(table)
    count = receipt.snapshots
    snapshots = "one snapshot" if count == 1 else f"{count} snapshots"
    tell(console, f"geometry: {snapshots}; state in {receipt.dtype}")


def structure_lines(report: dict[str, Any]) -> list[str]:
    """What stands for a body, and what heat capacity it lacks or has too much.

    Args:
        report: of `structure_report`.
    """
    kind = re.sub(r"(?<!^)(?=[A-Z])", " ", report["kind"]).lower()
    nodes, links = _count(report["nodes"], "node"), _count(report["links"], "link")
    size = readable_bytes(report["bytes_float32"]["total"])
    lines = [f"{kind}: {nodes}, {links}, {size}"]
    ratio = report["capacity_ratio"]
    if abs(ratio - 1) > KEPT:
        # Two digits of what is missing: 62 %, but 99.95 % and not 100 %.
        decimals = max(0, 1 - math.floor(math.log10(100 * abs(ratio - 1))))
        held = f"{100 * ratio:.{decimals}f}"
        lines.append(f"the structure holds {held} % of the body's heat capacity")
    return lines


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def tell_result(console: Console, solution: Solution, times: dict[str, float]) -> None:
    """What it cost, how warm it became, and how well the energies add up."""
    residual = float(abs(solution.energy.residual_relative).max())
    surface = solution.surface_temperature[-1] - ZERO_CELSIUS
    tell(
        console,
        f"set up {times['setup_time_s']:.1f} s, compiled {times['compile_time_s']:.1f} "
        f"s, ran {times['run_time_s']:.1f} s, drew {times['frames_time_s']:.1f} s; "
        f"peak memory {readable_bytes(peak_memory())}",
    )
    tell(
        console,
        f"at {time_label(float(solution.times[-1]))} the surface is at "
        f"{float(surface.min()):.1f} to "
        f"{float(surface.max()):.1f} degC; energy residual {residual:.1e}",
    )

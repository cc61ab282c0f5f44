"""Terminal output of a run: the scene, the receipt, and the result."""

import math
import re

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from ..console.terminal import print_line
from ..constants import ZERO_CELSIUS
from ..geometry.mesh import mesh_summary
from ..host_memory import readable_bytes
from ..image.colour.ticks import time_label
from ..integrate.heat_rates import evaluate_rates
from ..integrate.implicit.adaptive import AdaptiveStepper
from ..integrate.run.plan import Plan
from ..integrate.run.solution import Solution
from ..report.numbers import count
from ..report.table import Table
from ..scene.air import bodies_around_air, bodies_with_surface, body_name
from ..scene.body_mass import body_mass
from ..scene.compile.program import Compiled
from ..scene.scene import Body, Scene
from ..structures.kinds.sheet import Sheet
from ..structures.report import StructureReport
from .summary import peak_memory


# Smaller deviations of the capacity ratio from 1 are rounding [-].
_CAPACITY_TOLERANCE = 1e-6


def log_scene(
    console: Console, scene: Scene, plan: Plan, structures: list[StructureReport]
) -> None:
    """Print the bodies, with their `structure_report`, the receipt, and the steps."""
    for body, report in zip(bodies_with_surface(scene), structures, strict=True):
        grid = body.structure.grid
        edge = f"{grid.pitch * 1e3:.4g} mm"
        if isinstance(body.structure, Sheet):
            cells = f"{body.structure.surface_cells:,} cells of {edge} on a surface"
        else:
            shape = " x ".join(str(n) for n in grid.lattice.shape)
            count = body.structure.voxels.solid_count
            cells = f"{count:,} solid voxels of {edge} in {shape}"
        print_line(console, mesh_summary(grid.mesh))
        print_line(
            console,
            f"  {cells}, {len(grid.fragment_area):,} surface fragments",
        )
        for line in _structure_lines(report):
            print_line(console, f"  {line}")
        print_line(console, f"  {_sizes(body)}")
    for number, around in bodies_around_air(scene).items():
        air = scene.bodies[number]
        print_line(
            console,
            f"air of body {around}: {air.structure.volume:.4g} m3, "
            f"{body_mass(air):.4g} kg",
        )
    receipt = plan.compiled.receipt
    print_line(console, f"included: {', '.join(receipt.included)}")
    for omission in receipt.left_out:
        print_line(console, f"left out: {omission.what} ({omission.why})")
    for note in receipt.notes:
        print_line(console, f"note: {note}")
    limit = "none" if plan.stable_step is None else f"{plan.stable_step:.4g} s"
    steps = f"{plan.steps:,} steps"
    if isinstance(plan.stepper, AdaptiveStepper):
        steps = f"steps that follow the error, to {plan.steps:,} event times"
    elif plan.control is not None:
        steps += " or more, until the error in time holds"
    memory = f"about {readable_bytes(receipt.memory_bytes)} for the solver"
    mesh = plan.compiled.program.mesh
    if mesh is not None:
        per_device = readable_bytes(receipt.memory_bytes / mesh.size)
        memory += f", {per_device} on each of {mesh.size} devices"
    print_line(
        console,
        f"{type(plan.solver).__name__} ({plan.solver_reason}): {steps}, stable step "
        f"{limit}, {memory}",
    )


def log_receipt(console: Console, plan: Plan) -> None:
    """Print the receipt: mechanisms, with the bodies and areas on which they act."""
    receipt = plan.compiled.receipt
    airs = bodies_around_air(plan.scene)
    rows = [
        ("conduction", f"body {index} ({structure})", "", "", "", "")
        for index, structure in enumerate(receipt.structures)
        if index not in airs
    ]
    rates = _rates_at_start(plan.compiled)
    for mechanism, rate in zip(receipt.parts, rates, strict=True):
        where = " and ".join(body_name(index, airs) for index in mechanism.bodies)
        fraction = f"{100 * mechanism.surface_share:.3g} %" if mechanism.area else ""
        area = f"{mechanism.area:.4g} m2" if mechanism.area else ""
        volume = f"{mechanism.volume:.4g} m3" if mechanism.volume else ""
        heat = f"{rate:.4g} W"
        rows.append((mechanism.mechanism, where, area, fraction, volume, heat))
    columns = (
        "mechanism",
        "on",
        "area",
        "of the surface",
        "volume",
        "heat rate at the start",
    )
    console.print(Table(columns, rows, left=(0, 1), framed=False).rich())
    snapshots = count(receipt.snapshots, "snapshot")
    print_line(console, f"geometry: {snapshots}; state in {receipt.dtype}")


def _rates_at_start(compiled: Compiled) -> list[float]:
    """Heat rate of every part of the receipt at time 0 [W]."""
    start = jnp.zeros((), compiled.receipt.dtype)
    evaluate = eqx.filter_jit(evaluate_rates)
    _, rates = evaluate(compiled.program, compiled.state, start)
    return np.asarray(rates, float).tolist()


def _sizes(body: Body) -> str:
    structure = body.structure
    return (
        f"{body_mass(body):.4g} kg, {structure.volume:.4g} m3, "
        f"{float(structure.grid.fragment_area.sum()):.4g} m2"
    )


def _structure_lines(report: StructureReport) -> list[str]:
    name = re.sub(r"(?<!^)(?=[A-Z])", " ", report["kind"]).lower()
    factor = report["options"].get("factor")
    if factor is not None:
        edge = factor * report["pitch_m"] * 1e3
        name += f" x{factor} (blocks of {edge:.4g} mm)"
    nodes = count(report["nodes"], "node")
    links = count(report["links"], "link")
    size = readable_bytes(report["bytes_float32"]["total"])
    lines = [f"{name}: {nodes}, {links}, {size}"]
    ratio = report["capacity_ratio"]
    if abs(ratio - 1) > _CAPACITY_TOLERANCE:
        # Two digits of the deviation from 100 %: 62 %, but 99.95 % and not 100 %.
        decimals = max(0, 1 - math.floor(math.log10(100 * abs(ratio - 1))))
        percent = f"{100 * ratio:.{decimals}f}"
        lines.append(f"the structure holds {percent} % of the body's heat capacity")
    return lines


def log_result(
    console: Console, scene: Scene, solution: Solution, times: dict[str, float]
) -> None:
    """Print run times, peak memory, final temperatures and the energy residual."""
    residual = float(np.abs(np.asarray(solution.energy.residual_relative)).max())
    surface = np.asarray(solution.surface_temperature)[-1] - ZERO_CELSIUS
    print_line(
        console,
        f"set up {times['setup_time_s']:.1f} s, compiled {times['compile_time_s']:.1f} "
        f"s, ran {times['run_time_s']:.1f} s, drew {times['frames_time_s']:.1f} s; "
        f"peak memory {readable_bytes(peak_memory())}",
    )
    print_line(
        console,
        f"at {time_label(float(np.asarray(solution.times)[-1]))} the surface is at "
        f"{float(surface.min()):.1f} to {float(surface.max()):.1f} degC; "
        f"energy residual {residual:.1e}",
    )
    final = np.asarray(solution.mean_temperature)[-1] - ZERO_CELSIUS
    for number, around in bodies_around_air(scene).items():
        print_line(console, f"the air of body {around} is at {final[number]:.1f} degC")
    if solution.run.time_error is not None:
        # The last remark of the receipt is known after the run only.
        steps = f"{solution.run.steps:,} steps"
        print_line(console, f"{steps}, {solution.receipt.notes[-1]}")
    for warning in solution.run.warnings:
        print_line(console, f"warning: {warning}")

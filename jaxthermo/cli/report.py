"""Terminal output of a run: the scene, the receipt, and the result."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from ..alike_lines import grouped_lines
from ..console.terminal import print_line
from ..constants import ZERO_CELSIUS
from ..host_memory import readable_bytes
from ..image.colour.ticks import time_label
from ..integrate.heat_rates import evaluate_rates
from ..integrate.implicit.adaptive import AdaptiveStepper
from ..integrate.run.plan import Plan
from ..integrate.run.solution import Solution, SteadySolution
from ..report.numbers import count, significant
from ..report.table import Table
from ..scene.air import bodies_around_air, bodies_with_surface
from ..scene.body_mass import body_mass
from ..scene.compile.body_names import body_labels
from ..scene.compile.program import Compiled
from ..scene.receipt_model import Receipt
from ..scene.scene import Scene
from ..structures.report import StructureReport
from .body_lines import MAX_BODIES, ReceiptRow, body_lines, described, summed
from .summary import peak_memory


def log_scene(
    console: Console, scene: Scene, receipt: Receipt, structures: list[StructureReport]
) -> None:
    """Print the bodies, with their `structure_report`, and the receipt."""
    descriptions = [
        described(body, report)
        for body, report in zip(bodies_with_surface(scene), structures, strict=True)
    ]
    for line in body_lines(scene, descriptions):
        print_line(console, line)
    labels = body_labels(scene)
    airs = [
        f"{labels[air]}: {scene.bodies[air].structure.volume:.4g} m3, "
        f"{body_mass(scene.bodies[air]):.4g} kg"
        for air in bodies_around_air(scene)
    ]
    for line in grouped_lines(airs):
        print_line(console, line)
    print_line(console, f"included: {', '.join(receipt.included)}")
    left_out = [f"{omission.what} ({omission.why})" for omission in receipt.left_out]
    for line in grouped_lines(left_out):
        print_line(console, f"left out: {line}")
    for line in grouped_lines(receipt.notes):
        print_line(console, f"note: {line}")


def log_steps(console: Console, plan: Plan) -> None:
    """Print the solver of a run, its steps and its memory."""
    receipt = plan.compiled.receipt
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
    labels = body_labels(plan.scene)
    surfaces = len(bodies_with_surface(plan.scene))
    rows = [
        ReceiptRow(
            "conduction",
            where=f"{label} ({structure})",
            area=0.0,
            share=math.nan,
            volume=0.0,
            heat_rate=math.nan,
        )
        for label, structure in zip(
            labels[:surfaces], receipt.structures[:surfaces], strict=True
        )
    ]
    rates = _rates_at_start(plan.compiled)
    for part, rate in zip(receipt.parts, rates, strict=True):
        rows.append(
            ReceiptRow(
                part.mechanism,
                where=" and ".join(labels[index] for index in part.bodies),
                area=part.area,
                share=part.surface_share,
                volume=part.volume,
                heat_rate=rate,
                is_of_pair=len(part.bodies) == 2,
            )
        )
    if len(labels) > MAX_BODIES:
        rows = summed(rows)
    columns = (
        "mechanism",
        "on",
        "area",
        "of the surface",
        "volume",
        "heat rate at the start",
    )
    console.print(
        Table(columns, [row.cells for row in rows], left=(0, 1), framed=False).rich()
    )
    snapshots = count(receipt.snapshots, "snapshot")
    print_line(console, f"geometry: {snapshots}; state in {receipt.dtype}")


def _rates_at_start(compiled: Compiled) -> list[float]:
    """Heat rate of every part of the receipt at time 0 [W]."""
    start = jnp.zeros((), compiled.receipt.dtype)
    evaluate = eqx.filter_jit(evaluate_rates)
    _, rates = evaluate(compiled.program, compiled.state, start)
    return np.asarray(rates, float).tolist()


def log_result(
    console: Console, scene: Scene, solution: Solution, times: dict[str, float]
) -> None:
    """Print run times, peak memory, final temperatures and the energy residual."""
    print_line(
        console,
        f"set up {times['setup_time_s']:.1f} s, compiled {times['compile_time_s']:.1f} "
        f"s, ran {times['run_time_s']:.1f} s, drew {times['frames_time_s']:.1f} s; "
        f"peak memory {readable_bytes(peak_memory())}",
    )
    residual = float(np.abs(np.asarray(solution.energy.residual_relative)).max())
    _log_temperatures(console, scene, solution, f"energy residual {residual:.1e}")
    if solution.run.time_error is not None:
        # The last remark of the receipt is known after the run only.
        steps = f"{solution.run.steps:,} steps"
        print_line(console, f"{steps}, {solution.receipt.notes[-1]}")
    for warning in grouped_lines(solution.run.warnings):
        print_line(console, f"warning: {warning}")


def log_steady(
    console: Console, scene: Scene, solution: SteadySolution, times: dict[str, float]
) -> None:
    """Print times, peak memory, temperatures and heat rates of a steady state."""
    print_line(
        console,
        f"set up {times['setup_time_s']:.1f} s, solved {times['run_time_s']:.1f} s, "
        f"drew {times['frames_time_s']:.1f} s; "
        f"peak memory {readable_bytes(peak_memory())}",
    )
    residual = abs(float(solution.heat_rates.residual_relative))
    _log_temperatures(
        console, scene, solution, f"residual of the heat rates {residual:.1e}"
    )
    rates = [
        f"{name} {significant(float(rate))} W"
        for name, rate in solution.heat_rates.mechanisms.items()
    ]
    print_line(console, f"heat into the bodies: {', '.join(rates) or 'none'}")


def _log_temperatures(
    console: Console,
    scene: Scene,
    solution: Solution | SteadySolution,
    residual: str,
) -> None:
    """Print the last temperatures of the surface, with the residual, and of the air."""
    surface = np.asarray(solution.surface_temperature)[-1] - ZERO_CELSIUS
    print_line(
        console,
        f"at {time_label(float(np.asarray(solution.times)[-1]))} the surface is at "
        f"{float(surface.min()):.1f} to {float(surface.max()):.1f} degC; {residual}",
    )
    final = np.asarray(solution.mean_temperature)[-1] - ZERO_CELSIUS
    labels = body_labels(scene)
    airs = [
        f"the {labels[number]} is at {final[number]:.1f} degC"
        for number in bodies_around_air(scene)
    ]
    for line in grouped_lines(airs):
        print_line(console, line)

"""A cooling block as a component of Tesseract, whose derivatives other programs call.

`tesseract build` makes a container of a folder with this file. Here it runs in this
process: the derivative by the conductivity is compared with a difference quotient.
Needs the packages `tesseract-core[runtime]` and `tesseract-jax`.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from pydantic import BaseModel
from tesseract_core import Tesseract
from tesseract_core.runtime import Array, Differentiable, Float32
from tesseract_core.runtime.jax_recipes import (
    jax_abstract_eval,
    jax_apply,
    jax_jvp,
    jax_vjp,
)
from tesseract_jax import apply_tesseract

import jaxthermo as jt


GRID = jt.voxelize(jt.shapes.box((0.04, 0.02, 0.02)), pitch=0.005)
TIMES = (60.0, 120.0, 180.0)


class InputSchema(BaseModel):
    """Properties of the block and of the air."""

    conductivity: Differentiable[Float32]
    """[W/(m K)]"""
    heat_transfer_coefficient: Differentiable[Float32]
    """[W/(m^2 K)]"""


class OutputSchema(BaseModel):
    """What a camera would measure of one side."""

    surface_temperature: Differentiable[Array[(None,), Float32]]
    """Lowest temperature of the surface at each time [K]."""


@eqx.filter_jit
def temperatures(inputs: dict[str, Any]) -> dict[str, Any]:
    """The outputs from the inputs, as functions of JAX that has their derivatives."""
    steel = jt.Material(inputs["conductivity"], density=8000.0, specific_heat=500.0)
    body = jt.Body(jt.FullVolume(GRID), steel, temperature=350.0)
    side = jt.Side((1.0, 0.0, 0.0))
    air = jt.Convection(inputs["heat_transfer_coefficient"], 290.0, on=side)
    run = jt.simulate(
        jt.Scene((body,), (air,)), TIMES[-1], TIMES, solver=jt.ForwardEuler(dt=0.5)
    )
    return {"surface_temperature": run.surface_temperature.min(axis=1)}


def apply(inputs: InputSchema) -> OutputSchema:
    """Called for the outputs."""
    return OutputSchema(**jax_apply(temperatures, inputs))


def jacobian_vector_product(
    inputs: InputSchema,
    jvp_inputs: set[str],
    jvp_outputs: set[str],
    tangent_vector: dict[str, Any],
):
    """Called for forward derivatives."""
    return jax_jvp(temperatures, inputs, jvp_inputs, jvp_outputs, tangent_vector)


def vector_jacobian_product(
    inputs: InputSchema,
    vjp_inputs: set[str],
    vjp_outputs: set[str],
    cotangent_vector: dict[str, Any],
):
    """Called for reverse derivatives."""
    return jax_vjp(temperatures, inputs, vjp_inputs, vjp_outputs, cotangent_vector)


def abstract_eval(abstract_inputs: Any):
    """Called for the shapes of the outputs."""
    return jax_abstract_eval(temperatures, abstract_inputs)


def main() -> None:
    """Call the component from a program of JAX, and compare its derivative."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the same: it is small")
    parser.parse_args()
    block = Tesseract.from_tesseract_api(Path(__file__))

    def lowest(conductivity: jax.Array) -> jax.Array:
        inputs = {
            "conductivity": conductivity,
            "heat_transfer_coefficient": jnp.asarray(200.0),
        }
        return apply_tesseract(block, inputs)["surface_temperature"][-1]

    conductivity = jnp.asarray(16.0)
    slope = float(jax.grad(lowest)(conductivity))
    change = lowest(conductivity + 0.5) - lowest(conductivity - 0.5)
    difference = float(change)
    sys.stdout.write(
        f"lowest temperature {float(lowest(conductivity)):.2f} K, its derivative "
        f"{slope:.3f} K per W/(m K), difference quotient {difference:.3f}\n"
    )
    if abs(slope - difference) > 0.02 * abs(difference):
        raise SystemExit("the derivative is not the difference quotient")


if __name__ == "__main__":
    main()

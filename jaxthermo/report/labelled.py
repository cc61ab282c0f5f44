"""Results with labels: the `xarray.Dataset` of a solution, by time, body and name."""

from typing import Any

import numpy as np
import xarray as xr

from ..integrate.energy import Energy
from ..integrate.run.abstract_solution import AbstractSolution


_FRAGMENTS = ("time", "fragment")
_UNITS = {"heat_flux": "W/m^2", "heat_transfer_coefficient": "W/(m^2 K)"}


def dataset_of(solution: AbstractSolution) -> xr.Dataset:
    """The dataset of a solution, see `AbstractSolution.to_xarray`."""
    geometries = [surface.geometry for surface in solution.surfaces]
    labels = [geometry.name or f"body {n}" for n, geometry in enumerate(geometries)]
    counts = [len(geometry.fragment_area) for geometry in geometries]
    points = np.concatenate(
        [
            geometry.placed.to_world(geometry.fragment_position)
            for geometry in geometries
        ]
    )
    area = np.concatenate([geometry.fragment_area for geometry in geometries])
    dataset = xr.Dataset(
        {"surface_temperature": _values(_FRAGMENTS, solution.surface_temperature, "K")},
        coords={
            "time": _values(("time",), np.asarray(solution.times, float), "s"),
            "body_of_fragment": ("fragment", np.repeat(labels, counts)),
            "area": _values(("fragment",), area, "m^2"),
            **{
                axis: _values(("fragment",), points[:, n], "m")
                for n, axis in enumerate("xyz")
            },
        },
    )
    for name, unit in _UNITS.items():
        if getattr(solution, name) is not None:
            dataset[name] = _values(_FRAGMENTS, getattr(solution, name), unit)
    if solution.probe_temperature is not None:
        dataset["probe_temperature"] = _values(
            ("time", "probe"), solution.probe_temperature, "K"
        )
        dataset["probe"] = [probe.name for probe in solution.probes]
    if solution.mean_temperature is not None:
        dataset["mean_temperature"] = _values(
            ("time", "body"), solution.mean_temperature, "K"
        )
        # Air follows all bodies that have a surface.
        count = solution.mean_temperature.shape[1]
        airs = [f"body {n}, air" for n in range(len(labels), count)]
        dataset["body"] = [*labels, *airs]
    if solution.energy is not None:
        dataset = dataset.merge(_energies(solution.energy))
    return dataset


def _values(dims: tuple[str, ...], values: Any, unit: str) -> xr.Variable:
    return xr.Variable(dims, np.asarray(values), {"units": unit})


def _energies(energy: Energy) -> xr.Dataset:
    """Heat of all bodies, by mechanism, by body and by contact [J]."""
    nowhere = np.full(np.shape(energy.stored_J), np.nan)
    heat = [
        [body.mechanisms.get(name, nowhere) for name in energy.mechanisms]
        for body in energy.bodies
    ]
    shape = (len(energy.bodies), len(energy.mechanisms), len(nowhere))
    stored = [np.asarray(body.stored_J) for body in energy.bodies]
    contacts = [np.asarray(values) for values in energy.contacts.values()]
    by_contact = np.reshape(contacts, (len(contacts), len(nowhere)))
    return xr.Dataset(
        {
            "stored_heat": _values(("body", "time"), np.stack(stored), "J"),
            "heat": _values(
                ("body", "mechanism", "time"), np.reshape(heat, shape), "J"
            ),
            "contact_heat": _values(("contact", "time"), by_contact, "J"),
            "energy_residual": _values(("time",), energy.residual_relative, "1"),
        },
        coords={"mechanism": [*energy.mechanisms], "contact": [*energy.contacts]},
    ).transpose("time", ...)

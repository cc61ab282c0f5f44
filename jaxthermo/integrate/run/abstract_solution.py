"""A solution as cameras and measurements read it, computed or from a file.

`solution.npz` stores the surface, its temperatures, the radiation that reaches it and
what is around it: all that an image needs.
"""

import abc
import importlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ...archive import write_archive
from ...arrays import (
    HOST,
    HostTime,
    SplitTimes,
    Time,
    consecutive,
    device_array,
    is_traced,
    precision,
    split_times,
)
from ...errors import InputError
from ...extras import require_extra
from ...geometry.part_names import unmatched_name
from ...physics.radiation.irradiation import (
    Irradiance,
    SceneRadiation,
    SurfaceRadiation,
)
from ...physics.term import AbstractTerm
from ...physics.time_varying import just_before
from ...physics.windows import Window, over
from ...scene.named import Probe
from ...scene.receipt_model import Receipt
from ...scene.scene import SolvedSurface, per_fragment
from ...scene.surface_outputs import SURFACE_OUTPUTS
from ...shown import html_of
from ..energy import Energy, HeatRates
from .plain_values import plain_value
from .run_summary import RunSummary
from .solution_arrays import (
    FORMAT_VERSION,
    KIND,
    balance_columns,
    body_arrays,
    json_array,
)
from .stored_terms import seen_terms


SOLUTION_FILE = "solution.npz"
SUMMARY_FILE = "summary.json"
"""Files of a run in its folder."""
_TEMPERATURES_ALONE = (
    "this solution has temperatures alone: draw or save a solution of simulate, steady "
    "or load_run"
)


class AbstractSolution(Module):
    """Temperatures of the surface, with the bodies and terms that they belong to.

    A float64 scene gives numpy arrays where JAX is not set to 64 bits.
    """

    times: eqx.AbstractVar[Float[Array | np.ndarray, " t"]]
    surface_temperature: eqx.AbstractVar[Float[Array, "t s"]]
    surfaces: eqx.AbstractVar[tuple[SolvedSurface, ...]]
    terms: eqx.AbstractVar[tuple[AbstractTerm, ...]]
    mean_temperature: eqx.AbstractVar[Float[Array | np.ndarray, "t b"] | None]
    energy: eqx.AbstractVar[Energy | None]
    heat_rates: eqx.AbstractVar[HeatRates | None]
    receipt: eqx.AbstractVar[Receipt | None]
    run: eqx.AbstractVar[RunSummary | None]
    probes: eqx.AbstractVar[tuple[Probe, ...]]
    probe_temperature: eqx.AbstractVar[Float[Array, "t p"] | None]
    heat_flux: eqx.AbstractVar[Float[Array, "t s"] | None]
    heat_transfer_coefficient: eqx.AbstractVar[Float[Array, "t s"] | None]

    def _repr_html_(self) -> str:
        return html_of(self)

    @property
    def of_body(self) -> Callable[[int | str], Float[Array | np.ndarray, "t _"]]:
        """Function from the number or name of a body to its surface temperatures [K].

        A body of air has none.
        """
        # No method: equinox goes through all bodies of a solution to bind one.
        temperature = self.surface_temperature
        fragments = self._fragments_of_bodies
        numbers = self._numbers_by_name
        means = self.mean_temperature
        count = len(fragments) if means is None else means.shape[-1]

        def temperatures_of(body: int | str) -> Float[Array | np.ndarray, "t _"]:
            if isinstance(body, str) and body not in numbers:
                line = unmatched_name(body, list(numbers))
                raise InputError(f"solution.of_body: {line}")
            number = numbers[body] if isinstance(body, str) else body
            if not -count <= number < count:
                raise InputError(
                    f"solution.of_body: there is no body {number}; there are {count}: "
                    "count from 0"
                )
            has_surface = number < len(fragments)
            return temperature[:, fragments[number] if has_surface else slice(0, 0)]

        return temperatures_of

    @cached_property
    def _fragments_of_bodies(self) -> list[slice]:
        return consecutive(len(s.geometry.fragment_area) for s in self.surfaces)

    @cached_property
    def _numbers_by_name(self) -> dict[str, int]:
        names = [surface.geometry.name for surface in self.surfaces]
        return {name: number for number, name in enumerate(names) if name}

    def load_time(self, index: int) -> Time | HostTime:
        """Return the time whose loads the surface shows at a saved time [s]."""
        # What is switched at the saved time has not acted on the surface yet.
        return just_before(_row(self.times, index))

    @property
    def dtype(self) -> str:
        """Type of the temperatures, "float32" or "float64"."""
        return str(self.surface_temperature.dtype)

    @abc.abstractmethod
    def irradiance(self, index: int) -> Irradiance:
        """Return the radiation that reaches every fragment at a saved time [W/m^2].

        It is that of the heat balance: H thermal, E of sources.
        """

    def reflected(self, index: int) -> Float[Array, " s"]:
        """Return the radiation that every fragment reflects at a saved time [W/m^2].

        (1 - eps) H + (1 - a) E, with the irradiation of the heat balance: H thermal, E
        of sources.
        """
        return self._reflected_parts(index)[0]

    def reflected_sources(self, index: int) -> Float[Array, " s"]:
        """Return the part (1 - a) E of `reflected` that comes from sources [W/m^2]."""
        return self._reflected_parts(index)[1]

    def _reflected_parts(self, index: int) -> tuple[Array, Array]:
        with precision(self.dtype):
            return self.irradiance(index).reflected(
                per_fragment(self.surfaces, "emissivity"),
                per_fragment(self.surfaces, "absorptivity"),
            )

    def save(self, folder: str | Path) -> None:
        """Write `solution.npz` into a folder, from which `load_run` reads it.

        The folder is made if there is none.

        Raises:
            InputError: for a folder that has the results of a command or cannot be
                written, and for a solution without radiation or with traced values.
        """
        if is_traced(self):
            raise InputError(
                "solution.save: its values are traced: save it outside of jax.jit, "
                "grad and vmap"
            )
        path = Path(folder).expanduser()
        if (path / SUMMARY_FILE).exists():
            raise InputError(
                f"solution.save: {path} has the results of `jaxthermo simulate`; name "
                "another folder"
            )
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(
                f"solution.save: {path} cannot be created: {reason}; name another "
                "folder"
            ) from error
        write_archive(
            path / SOLUTION_FILE,
            format_name=KIND,
            version=FORMAT_VERSION,
            arrays=_arrays(self.stored()),
        )

    def to_xarray(self) -> Any:
        """Return the results as an `xarray.Dataset` by time, body and mechanism.

        Temperatures of fragments have the body, the position at the start [m] and the
        area [m^2] of each; energies are NaN for mechanisms that do not act on a body.

        Raises:
            InputError: without the extra `labels`.
        """
        require_extra("to_xarray: it needs", package="xarray", extra="labels")
        # By name: reports are above this folder.
        labelled: Any = importlib.import_module("jaxthermo.report.labelled")
        return labelled.dataset_of(self)

    def stored(self) -> "StoredSolution":
        """Return the part of the solution that a file stores."""
        rows = [self.irradiance(k) for k in range(len(self.times))]
        receipt = self.receipt
        if receipt is not None:
            # What one process searched for, another one remembers: no part of a result.
            receipt = replace(receipt, searches=())
        return StoredSolution(
            times=np.asarray(self.times, float),
            surface_temperature=np.asarray(self.surface_temperature),
            surfaces=self.surfaces,
            irradiances=Irradiance(
                *(
                    np.stack([np.asarray(values) for values in column])
                    for column in zip(*rows, strict=True)
                )
            ),
            terms=seen_terms(self.terms),
            mean_temperature=_on_host(self.mean_temperature),
            energy=jax.tree.map(np.asarray, self.energy),
            heat_rates=jax.tree.map(np.asarray, self.heat_rates),
            receipt=receipt,
            run=jax.tree.map(np.asarray, self.run),
            probes=self.probes,
            probe_temperature=_on_host(self.probe_temperature),
            heat_flux=_on_host(self.heat_flux),
            heat_transfer_coefficient=_on_host(self.heat_transfer_coefficient),
        )


class AbstractComputedSolution(AbstractSolution):
    """A solution with the radiation of its scene."""

    radiation: eqx.AbstractVar[SceneRadiation]
    receipt: eqx.AbstractVar[Receipt]
    run: eqx.AbstractVar[RunSummary]

    @override
    def irradiance(self, index: int) -> Irradiance:
        with precision(self.dtype):
            temperature = device_array(_row(self.surface_temperature, index))
            radiation = self.radiation.at(_row(self.times, index))
            time = self.load_time(index)
            if not isinstance(time, HOST):
                return irradiance_at(radiation, time, temperature)
            # Late in a run float32 does not tell it from the saved time.
            start = device_array(split_times(time), temperature.dtype)
            now = device_array(np.zeros(()), temperature.dtype)
            return irradiance_at(radiation, now, temperature, start)


@eqx.filter_jit
def irradiance_at(
    radiation: SurfaceRadiation,
    time: Float[Array, ""],
    temperature: Float[Array, " s"],
    start: SplitTimes | None = None,
) -> Irradiance:
    """Return the irradiance of surfaces at temperatures [K].

    The time counts from `start`; None for the start of the run.
    """
    if start is not None:
        radiation = over(radiation, Window(start, jnp.zeros_like(time)))
    return radiation.irradiance(time, temperature)


class StoredSolution(AbstractSolution):
    """The part of a solution that a file stores, from `load_run`.

    It is drawn, measured and compared as the solution of the run.
    """

    times: Float[Array | np.ndarray, " t"]
    """[s]"""
    surface_temperature: Float[Array | np.ndarray, "t s"]
    """Temperature of every fragment, bodies one after the other [K]."""
    surfaces: tuple[SolvedSurface, ...]
    irradiances: Irradiance | None = None
    """Radiation that reaches every fragment, with the times as its first axis; None
    where no image is drawn."""
    terms: tuple[AbstractTerm, ...] = ()
    """Sky, ground, air and sources as a camera sees them, see `seen_terms`."""
    mean_temperature: Float[Array | np.ndarray, "t b"] | None = None
    """Capacity-weighted mean of each body [K]."""
    energy: Energy | None = None
    """Energies [J]; None of a steady state."""
    heat_rates: HeatRates | None = None
    """Heat rates of a steady state [W]; None of a run."""
    receipt: Receipt | None = eqx.field(static=True, default=None)
    """Terms included and left out, and the remarks on them."""
    run: RunSummary | None = None
    """Steps and solver."""
    probes: tuple[Probe, ...] = eqx.field(static=True, default=())
    probe_temperature: Float[Array | np.ndarray, "t p"] | None = None
    """At the scene's probes [K]; None without any."""
    heat_flux: Float[Array | np.ndarray, "t s"] | None = None
    """Heat flux into every fragment [W/m^2], if the scene asks for it."""
    heat_transfer_coefficient: Float[Array | np.ndarray, "t s"] | None = None
    """Coefficient of every fragment [W/(m^2 K)], if the scene asks for it."""

    @override
    def load_time(self, index: int) -> Time | HostTime:
        # The loads of a steady state are those of its own time.
        if self.heat_rates is not None:
            return _row(self.times, index)
        return super().load_time(index)

    @override
    def irradiance(self, index: int) -> Irradiance:
        if self.irradiances is None:
            raise InputError(_TEMPERATURES_ALONE)
        return Irradiance(*(rows[index] for rows in self.irradiances))

    @override
    def stored(self) -> "StoredSolution":
        return self

    def at_times(self, times: tuple[float, ...], path: Path) -> "StoredSolution":
        """Reduce a user's reference, read from `path`, to the times of a run [s].

        Raises:
            InputError: if one of them is not saved there.
        """
        saved = np.asarray(self.times, float)
        # Files may hold float32 times.
        rows = [np.flatnonzero(np.isclose(saved, t, rtol=1e-5)) for t in times]
        missing = [t for t, row in zip(times, rows, strict=True) if not len(row)]
        if missing:
            listed = ", ".join(f"{t:g}" for t in missing[:5])
            raise InputError(
                f"{path}: nothing is saved at {listed} s there: the run and its "
                "reference need the same save times"
            )
        selected_rows = jnp.asarray([int(row[0]) for row in rows])
        surface = self.surface_temperature[selected_rows]
        return StoredSolution(jnp.asarray(times), surface, self.surfaces)


def _arrays(solution: StoredSolution) -> Mapping[str, Any]:
    """All arrays of a file, by name."""
    if solution.irradiances is None:
        raise InputError(_TEMPERATURES_ALONE)
    times = np.asarray(solution.times, float)
    load_times = [solution.load_time(index) for index in range(len(times))]
    arrays: dict[str, Any] = {
        name: getattr(solution, name)
        for name in ("times", "surface_temperature", "mean_temperature")
    }
    arrays["irradiance"] = solution.irradiances.thermal
    arrays["irradiance_sources"] = solution.irradiances.sources
    arrays["source_spectrum"] = solution.irradiances.spectrum
    arrays["terms"] = json_array(plain_value(solution.terms, load_times))
    balances = {"energy": solution.energy, "heat_rates": solution.heat_rates}
    for name, balance in balances.items():
        if balance is not None:
            columns = dict(balance_columns(balance))
            arrays[name] = np.stack(list(columns.values()), axis=-1).reshape(
                len(times), len(columns)
            )
            arrays["balance_columns"] = json_array(list(columns))
    for name in ("receipt", "run"):
        if getattr(solution, name) is not None:
            arrays[name] = json_array(plain_value(getattr(solution, name)))
    # Optional outputs of the scene.
    for name in (*SURFACE_OUTPUTS, "probe_temperature"):
        if getattr(solution, name) is not None:
            arrays[name] = getattr(solution, name)
    if solution.probes:
        arrays["probe_position"] = [probe.position for probe in solution.probes]
        arrays["probe_names"] = json_array([probe.name for probe in solution.probes])
    for b, surface in enumerate(solution.surfaces):
        for field, value in body_arrays(surface, times).present().items():
            arrays[f"body{b}_{field}"] = value
    return arrays


def _on_host(values: Any) -> Any:
    return None if values is None else np.asarray(values)


def _row(values: Float[Array | np.ndarray, "t *_"], index: int) -> Any:
    """Values of a saved time, on the host if known: indexing there compiles nothing."""
    return values[index] if is_traced(values) else np.asarray(values)[index]

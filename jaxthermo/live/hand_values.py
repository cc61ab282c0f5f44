"""Values of a config's terms that can be moved by hand, as sliders."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ..config.schema.scene import SceneConfig, unit_of
from ..image.colour.ticks import to_celsius


class _Slider(NamedTuple):
    """One number, in the unit of its label."""

    label: str
    low: float
    high: float
    step: float
    value: float


class HandValue(NamedTuple):
    """A value of a term: one number, or a direction as angles."""

    title: str
    """Kind of the term."""
    path: str
    """Path in the config."""
    sliders: tuple[_Slider, ...]
    text: Callable[[tuple[float, ...]], str]
    """The value as YAML, from the numbers of the sliders."""


# Largest numbers of sliders by unit, unless the config has a larger one.
_HIGHEST = {"W/m^2": 1500.0, "W/(m^2 K)": 100.0, "m/s": 10.0}
# Range of temperatures below and above that of the config [K].
_AROUND = 60.0


def hand_values(config: SceneConfig) -> tuple[HandValue, ...]:
    """The numbers and directions of all terms that do not follow a table."""
    return tuple(_values(config))


def _values(config: SceneConfig) -> Iterator[HandValue]:
    term_kinds = [term.kind for term in config.terms]
    for n, term in enumerate(config.terms):
        title = term.kind.replace("_", " ")
        if term_kinds.count(term.kind) > 1:
            title = f"{title} {term_kinds[:n].count(term.kind) + 1}"
        for name, value in term:
            path = f"terms.{n}.{name}"
            unit = unit_of(path)
            if name == "direction" and isinstance(value, tuple):
                yield _direction(title, path, value)
            elif name == "velocity" and isinstance(value, tuple):
                yield _velocity(title, path, value)
            elif isinstance(value, float) and unit is not None and name != "until":
                yield _number(
                    title,
                    path=path,
                    name=name.replace("_", " "),
                    value=value,
                    unit=unit.symbol,
                )


def _number(title: str, path: str, name: str, value: float, unit: str) -> HandValue:
    if unit == "K":
        celsius = round(to_celsius(value), 2)
        # A slider's steps count from its low end, so that the config's value is a step.
        slider = _Slider(
            label=f"{name} [°C]",
            low=celsius - _AROUND,
            high=celsius + _AROUND,
            step=0.5,
            value=celsius,
        )
        return HandValue(
            title=title, path=path, sliders=(slider,), text=lambda v: f"{v[0]:.6g} degC"
        )
    high = max(_HIGHEST.get(unit, 0.0), 3.0 * abs(value)) or 1.0
    step = 10.0 ** math.floor(math.log10(high) - 2)
    low = -high if value < 0 else 0.0
    symbol = unit.replace("^2", "²").replace("^3", "³")
    slider = _Slider(
        label=f"{name} [{symbol}]", low=low, high=high, step=step, value=value
    )
    return HandValue(
        title=title, path=path, sliders=(slider,), text=lambda v: f"{v[0]:.6g} {unit}"
    )


def _direction(title: str, path: str, value: tuple[float, ...]) -> HandValue:
    # Rays travel along the direction: they come from the opposite side.
    x, y, z = (-component / math.hypot(*value) for component in value)
    elevation, azimuth = (
        float(round(math.degrees(a))) for a in (math.asin(z), math.atan2(y, x))
    )
    sliders = (
        _Slider(label="azimuth [°]", low=-180.0, high=180.0, step=1.0, value=azimuth),
        _Slider(label="elevation [°]", low=-90.0, high=90.0, step=1.0, value=elevation),
    )

    def text(angles: tuple[float, ...]) -> str:
        around, up = (math.radians(angle) for angle in angles)
        level = math.cos(up)
        towards = level * math.cos(around), level * math.sin(around), math.sin(up)
        return str([-component for component in towards])

    return HandValue(title=title, path=path, sliders=sliders, text=text)


def _velocity(title: str, path: str, value: tuple[float, ...]) -> HandValue:
    x, y, z = value
    level = math.hypot(x, y)
    sliders = (
        _Slider(
            label="speed [m/s]",
            low=0.1,
            high=max(10.0, 3.0 * level),
            step=0.1,
            value=max(0.1, level),
        ),
        _Slider(
            label="blows towards [°]",
            low=-180.0,
            high=180.0,
            step=1.0,
            value=float(round(math.degrees(math.atan2(y, x)))),
        ),
    )

    def text(numbers: tuple[float, ...]) -> str:
        speed = numbers[0]
        around = math.radians(numbers[1])
        return str([speed * math.cos(around), speed * math.sin(around), z])

    return HandValue(title=title, path=path, sliders=sliders, text=text)

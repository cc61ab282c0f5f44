"""A config file, read, changed by overrides, validated, and written out again."""

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..errors import InputError
from .fields import ALLOW_EXTREME
from .found import FOLDERS
from .messages import described, in_file
from .model import Location
from .overrides import Change, with_overrides
from .schema import SceneConfig
from .strict_yaml import read_yaml, write_yaml


def load_config(
    path: str | Path, overrides: Sequence[str] = (), *, find_meshes: bool = True
) -> SceneConfig:
    """The config in a YAML file, with meshes found and all values in SI units.

    Args:
        path: the file; meshes, labels and masks are looked for beside it, then in
            JAXTHERMO_MESHES.
        overrides: "a.b=c" each, applied in order; c is YAML.
        find_meshes: whether a file that is named and not there is a mistake.

    Raises:
        InputError: one line for each mistake in the config.
    """
    path = Path(path)
    read = read_yaml(path)
    data, changed = with_overrides(read, overrides)
    data = {"name": path.stem, **data}
    try:
        return _validated(data, mesh_folders(path.parent) if find_meshes else ())
    except ValidationError as error:
        source = lambda place: in_file(_blamed(place, read, changed) or path, place)
        raise InputError(described(error, source)) from error


def mesh_folders(beside: Path) -> tuple[Path, ...]:
    """Where meshes are looked for: a folder, then those of JAXTHERMO_MESHES."""
    named = os.environ.get("JAXTHERMO_MESHES", "").split(os.pathsep)
    return (beside.resolve(), *(Path(folder).resolve() for folder in named if folder))


def resolved(config: SceneConfig) -> dict[str, Any]:
    """The config as plain values in SI units, as `summary.json` keeps it."""
    return config.model_dump(mode="json", exclude_none=True)


def to_yaml(config: SceneConfig) -> str:
    """The config as text that loads again to an equal config."""
    return write_yaml(resolved(config))


def config_hash(config: SceneConfig) -> str:
    """16 hex digits that change with the scene, but not with the folder it lies in.

    Files count with their content where they are there, else with their names.
    """
    plain = config.model_dump(exclude_none=True)
    separators = (",", ":")
    text = json.dumps(plain, sort_keys=True, separators=separators, default=_content)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _content(path: Path) -> str:
    """What stands for a file in a hash."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return path.name


def _validated(data: dict[str, Any], folders: tuple[Path, ...]) -> SceneConfig:
    extreme = data.get(ALLOW_EXTREME) is True
    context = {ALLOW_EXTREME: extreme, FOLDERS: folders}
    return SceneConfig.model_validate(data, context=context)


def _blamed(place: Location, read: Any, changed: list[Change]) -> str:
    """The override that the value there came with; empty for none."""
    found = [text for where, text in changed if _is_from(place, where, read)]
    return f"--set {found[-1]}" if found else ""


def _is_from(path: Location, where: Location, read: Any) -> bool:
    """Whether the value at the path came with the override that set `where`."""
    if path[: len(where)] == where:
        return True
    return where[: len(path)] == path and not _holds(read, path)


def _holds(data: Any, path: Location) -> bool:
    for key in path:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return False
    return True

"""A config file, read, changed by overrides, validated, and written out again."""

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from ..errors import InputError
from .messages import described, in_file
from .overrides import Change, with_overrides
from .schema.scene import SceneConfig
from .strict_yaml import read_yaml, write_yaml
from .types.files import FOLDERS
from .types.model import Location, Model
from .types.quantities import ALLOW_EXTREME


AnyModel = TypeVar("AnyModel", bound=Model)


def load_config(
    path: str | Path, overrides: Sequence[str] = (), *, find_meshes: bool = True
) -> SceneConfig:
    """The config of a scene; see `load_model`."""
    return _load_model(SceneConfig, path, overrides, find_files=find_meshes)


def _load_model(
    model: type[AnyModel],
    path: str | Path,
    overrides: Sequence[str] = (),
    *,
    find_files: bool = True,
) -> AnyModel:
    """The config in a YAML file, with files found and all values in SI units.

    Args:
        model: type of the config; one with a `name` gets the file's, if none is given.
        path: the file; meshes, labels and masks are searched for beside it, then in
            the folders of JAXTHERMO_MESHES.
        overrides: texts "a.b=c", applied in order; c is YAML.
        find_files: False to accept files that are named and do not exist.

    Raises:
        InputError: one line for each mistake in the config.
    """
    path = Path(path)
    read = read_yaml(path)
    data, changed = with_overrides(read, overrides)
    if "name" in model.model_fields:
        data = {"name": path.stem, **data}
    context = {
        ALLOW_EXTREME: data.get(ALLOW_EXTREME) is True,
        FOLDERS: mesh_folders(path.parent) if find_files else (),
    }
    try:
        return model.model_validate(data, context=context)
    except ValidationError as error:
        source = lambda where: in_file(
            _override_at(where, read, changed) or path, where
        )
        raise InputError(described(error, source)) from error


def mesh_folders(beside: Path) -> tuple[Path, ...]:
    """Folders that are searched for files: the given one, those of JAXTHERMO_MESHES."""
    named = os.environ.get("JAXTHERMO_MESHES", "").split(os.pathsep)
    return (beside.resolve(), *(Path(folder).resolve() for folder in named if folder))


def resolved(config: Model) -> dict[str, Any]:
    """The config as plain values in SI units, as `summary.json` records it."""
    return config.model_dump(mode="json", exclude_none=True)


def to_yaml(config: Model) -> str:
    """The config as text that loads again to an equal config."""
    return write_yaml(resolved(config))


def config_hash(config: Model) -> str:
    """16 hex digits that depend on the scene, but not on the folder it is in.

    Files count with their content if they exist, else with their names.
    """
    plain = config.model_dump(exclude_none=True)
    separators = (",", ":")
    text = json.dumps(plain, sort_keys=True, separators=separators, default=_content)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _content(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return path.name


def _override_at(where: Location, read: Any, changed: list[Change]) -> str:
    """The last override that the value at the location came with; empty for none."""
    found = [text for target, text in changed if _is_from(where, target, read)]
    return f"--set {found[-1]}" if found else ""


def _is_from(where: Location, target: Location, read: Any) -> bool:
    if where[: len(target)] == target:
        return True
    # Above the target: a mapping that only the override made.
    return target[: len(where)] == where and not _contains(read, where)


def _contains(data: Any, path: Location) -> bool:
    for key in path:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return False
    return True

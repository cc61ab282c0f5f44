"""A config file, read, changed by `--set`, validated, and written out again."""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from pydantic import ValidationError

from ..archive import file_hash, text_hash
from ..errors import InputError
from ..temperatures import ALLOW_EXTREME
from .messages import close_match, described, dotted, in_file, quoted
from .schema.dataset import DatasetConfig
from .schema.scene import SceneConfig
from .strict_yaml import NEEDS, parse_yaml, read_yaml, write_yaml
from .types.files import FOLDERS
from .types.model import Data, Location, Model, Short, field_parts


# Keys whose mapping has paths as keys: what follows in a location is one path.
_PATH_KEYS = ("set", "variations", "ranges")

# Location of a value that an override set, and the text of the override.
_Change: TypeAlias = tuple[Location, str]
_Model = TypeVar("_Model", bound=Model)


def load_config(
    path: str | Path, overrides: Sequence[str] = (), *, find_meshes: bool = True
) -> SceneConfig:
    """The config in a YAML file, with files found and all values in SI units.

    Args:
        path: the file, whose name is the scene's default name. Meshes, labels and
            masks are searched for in its folder, then in those of JAXTHERMO_MESHES.
        overrides: texts "a.b=c", applied in order; c is YAML.
        find_meshes: False to accept names of files that do not exist.

    Raises:
        InputError: one line for each mistake in the config.
    """
    path = Path(path)
    read = read_yaml(path)
    data, changed = _with_overrides(read, overrides)

    def source(location: Location) -> str:
        override = _override_at(location, read=read, changed=changed)
        return in_file(override or path, location)

    return _validated(
        SceneConfig, data=data, path=path, find_files=find_meshes, source=source
    )


def load_dataset(path: str | Path, overrides: Sequence[str] = ()) -> DatasetConfig:
    """The config of a dataset in a YAML file.

    Raises:
        InputError: one line for each mistake in the config.
    """
    needs = "a dataset needs `scene`, and `views`, `orbit` or `path`"
    return load_model(DatasetConfig, path, overrides=overrides, needs=needs)


def load_model(
    model: type[_Model],
    path: str | Path,
    overrides: Sequence[str] = (),
    *,
    needs: str = NEEDS,
) -> _Model:
    """The config in a YAML file; a scene that it names is searched for in its folder.

    Args:
        model: of the config.
        path: the file, whose name is the default of a `name`.
        overrides: texts "a.b=c", applied in order; c is YAML.
        needs: what the message for an empty file says.

    Raises:
        InputError: one line for each mistake in the config.
    """
    path = Path(path)
    data, _ = _with_overrides(read_yaml(path, needs), overrides)
    return _validated(
        model,
        data=data,
        path=path,
        find_files=True,
        source=partial(in_file, path),
    )


def _validated(
    model: type[_Model],
    data: Data,
    path: Path,
    find_files: bool,
    source: Callable[[Location], str],
) -> _Model:
    if "name" in model.model_fields:
        data = {"name": path.stem, **data}
    context = {
        ALLOW_EXTREME: data.get(ALLOW_EXTREME) is True,
        FOLDERS: _mesh_folders(path.parent) if find_files else (),
    }
    try:
        return model.model_validate(data, context=context)
    except ValidationError as error:
        raise InputError(described(error, source)) from error


def _mesh_folders(config_folder: Path) -> tuple[Path, ...]:
    """Folders that are searched for files: the config's, those of JAXTHERMO_MESHES."""
    named = os.environ.get("JAXTHERMO_MESHES", "").split(os.pathsep)
    return (
        config_folder.resolve(),
        *(Path(folder).resolve() for folder in named if folder),
    )


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
    # A file is read once, however many bodies are of it.
    content = cache(_content)
    text = json.dumps(plain, sort_keys=True, separators=separators, default=content)
    return text_hash(text)


# A mesh that changed is another scene, whatever its name.
def _content(path: Path) -> str:
    try:
        return file_hash(path)
    except OSError:
        return path.name


def _with_overrides(data: Any, texts: Sequence[str]) -> tuple[Any, list[_Change]]:
    """A copy of the data with texts "a.b=c" applied in order; c is YAML.

    Raises:
        InputError: for a text of another form, or a path that the data cannot have.
    """
    changed: list[_Change] = []
    for text in texts:
        path, equals, value = text.partition("=")
        keys = [key.strip() for key in path.split(".")]
        if not equals or not all(keys):
            raise InputError(
                f"--set {text}: expected a path and a value, such as a.b=3"
            )
        location = tuple(int(key) if key.isdigit() else key for key in keys)
        parsed = parse_yaml(value, f"--set {text}")
        try:
            data = _replaced(data, remaining=location, value=parsed, prefix=())
        except InputError as error:
            raise InputError(f"--set {error}") from error
        changed.append((location, text))
    return data, changed


def _replaced(data: Any, remaining: Location, value: Any, prefix: Location) -> Any:
    if not remaining:
        return value
    key = remaining[0]
    location = (*prefix, key)
    if isinstance(data, list):
        if not isinstance(key, int):
            raise InputError(
                f"{dotted(location)}: `{dotted(prefix)}` is a list: give an index, "
                "such as 0"
            )
        if key >= len(data):
            raise InputError(
                f"{dotted(location)}: `{dotted(prefix)}` has {len(data)} entries, "
                "counted from 0"
            )
        replaced = _replaced(
            data[key], remaining=remaining[1:], value=value, prefix=location
        )
        return [*data[:key], replaced, *data[key + 1 :]]
    if prefix and prefix[-1] in _PATH_KEYS:
        key = dotted(remaining)
        remaining = (key,)
    # A word may stand for a whole mapping, in which one value is replaced.
    if data is None or data == "auto":
        data = {}
    elif isinstance(data, str) and (word_key := _word_key(prefix)) is not None:
        data = {word_key: data}
    if not isinstance(data, dict):
        raise InputError(
            f"{dotted(location)}: `{dotted(prefix)}` is {quoted(data)} in the config, "
            f"which has no parts; set `{dotted(prefix)}` as a whole"
        )
    if isinstance(key, int):
        hint = close_match(key, data)
        raise InputError(f"{dotted(location)}: `{dotted(prefix)}` is not a list{hint}")
    if len(remaining) > 1 and key not in data and isinstance(remaining[1], int):
        raise InputError(f"{dotted(location)}: no such list{close_match(key, data)}")
    replaced = _replaced(
        data.get(key), remaining=remaining[1:], value=value, prefix=location
    )
    # A mesh has either a `unit` or a `height`: setting one removes the other.
    groups = [group for model in _models() for group in model.exactly_one]
    alternatives = {name for group in groups if key in group for name in group}
    removed = alternatives - {key}
    unchanged = {name: v for name, v in data.items() if name not in removed}
    return {**unchanged, key: replaced}


def _models(base: type[Model] = Model) -> Iterator[type[Model]]:
    for model in base.__subclasses__():
        yield model
        yield from _models(model)


def _word_key(location: Location) -> str | None:
    """The key that a word alone stands for, as `kind` for "octree" in `structure`."""
    last = str(location[-1]) if location else ""
    models = (model for model in _models() if last in model.model_fields)
    for model in models:
        for marker in field_parts(model, last):
            if isinstance(marker, Short):
                return marker.key
    return None


def _override_at(location: Location, read: Any, changed: list[_Change]) -> str:
    # The last override of the value is the wrong one. A mapping above the target of an
    # override may exist by the override alone.
    in_file_too = _contains(read, location)
    override = ""
    for target, text in changed:
        is_below = location[: len(target)] == target
        is_above = target[: len(location)] == location
        if is_below or (is_above and not in_file_too):
            override = f"--set {text}"
    return override


def _contains(data: Any, path: Location) -> bool:
    for key in path:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return False
    return True

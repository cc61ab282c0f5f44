"""Files that a later command reads: a format, its version, a schema and a checksum.

A file that is cut off, changed, or of another version is refused in one line, before
any of its values are used.
"""

import hashlib
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from jaxtyping import jaxtyped

from .atomic import replacing
from .errors import InputError


_FORMAT = "format"
_VERSION = "format_version"
_CHECKSUM = "checksum"

_ARCHIVE = "jaxthermo {}"
"""Format of an `.npz` file; that of a record is its name alone."""

_COMPRESSION = 1
"""Level of zlib: higher ones are slower and hardly make the files smaller."""

_SchemaT = TypeVar("_SchemaT", bound=tuple)


def write_archive(
    path: Path,
    format_name: str,
    version: int,
    arrays: Mapping[str, Any],
    compress: bool = True,
) -> None:
    """Write arrays as an `.npz` file that `read_archive` accepts, in one step.

    Args:
        path: path of the file.
        format_name: what the file is, in a word or two, such as "solution".
        version: version of the format; it changes with names, shapes and meanings of
            arrays.
        arrays: arrays by name.
        compress: False where speed counts more than size.
    """
    plain = {name: np.asarray(value) for name, value in arrays.items()}
    plain |= {
        _FORMAT: np.array(_ARCHIVE.format(format_name)),
        _VERSION: np.array(version),
    }
    plain[_CHECKSUM] = np.array(arrays_checksum(plain))
    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with (
        replacing(path) as temporary,
        zipfile.ZipFile(temporary, "w", method, compresslevel=_COMPRESSION) as file,
    ):
        for name, value in plain.items():
            with file.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, value, allow_pickle=False)


def read_archive(
    path: Path, format_name: str, version: int, remedy: str
) -> dict[str, np.ndarray]:
    """Read the arrays of a file of `write_archive`.

    Args:
        path: path of the file, which exists.
        format_name: as it was written.
        version: version that the caller reads.
        remedy: what to do with a file that cannot be read, for the message.

    Raises:
        InputError: if it is of another kind or version, or damaged.
    """
    check_regular(path, remedy)
    try:
        # Opened here, since np.load leaves a damaged file that it opened itself open.
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception as error:
        # numpy and zipfile raise many types for a damaged file.
        raise InputError(
            f"{path}: not a {format_name} of jaxthermo, or damaged "
            f"({type(error).__name__}); {remedy}"
        ) from error
    written = _ARCHIVE.format(format_name)
    return _checked(
        path,
        format_name=format_name,
        version=version,
        remedy=remedy,
        stored=arrays,
        checksum=arrays_checksum,
        written=written,
    )


def signed(
    format_name: str, version: int, content: Mapping[str, Any]
) -> dict[str, Any]:
    """Plain values with format, version and checksum, as `read_record` expects them."""
    described = {_FORMAT: format_name, _VERSION: version, **content}
    return {**described, _CHECKSUM: plain_checksum(described)}


def read_record(
    path: Path, format_name: str, version: int, remedy: str
) -> dict[str, Any]:
    """Read the content of a JSON file that was written with `signed` values.

    Args:
        path: path of the file.
        format_name: as it was written.
        version: version that the caller reads.
        remedy: what to do with a file that cannot be read, for the message.

    Raises:
        InputError: if it is missing, of another kind or version, or damaged.
    """
    check_regular(path, remedy)
    try:
        content = json.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path}: cannot be read: {reason}; {remedy}") from error
    # The bytes are no text, the text is no JSON, or brackets have no end.
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: damaged ({reason}); {remedy}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a {format_name} of jaxthermo; {remedy}")
    return _checked(
        path,
        format_name=format_name,
        version=version,
        remedy=remedy,
        stored=content,
        checksum=plain_checksum,
        written=format_name,
    )


def _checked(
    path: Path,
    format_name: str,
    version: int,
    remedy: str,
    stored: dict[str, Any],
    checksum: Callable[[dict[str, Any]], str],
    written: str,
) -> dict[str, Any]:
    """Content of a file whose format, version and checksum are as they should be."""
    # Compared as text: a foreign file may store anything under these names.
    head = {key: str(stored.get(key)) for key in (_FORMAT, _VERSION, _CHECKSUM)}
    if _VERSION in stored and head[_VERSION] != str(version):
        refuse_version(
            path,
            format_name=format_name,
            stored_version=head[_VERSION],
            version=version,
            remedy=remedy,
        )
    if _VERSION not in stored or head[_FORMAT] != written:
        raise InputError(f"{path}: not a {format_name} of jaxthermo; {remedy}")
    if head[_CHECKSUM] != checksum({k: stored[k] for k in stored if k != _CHECKSUM}):
        raise InputError(
            f"{path}: damaged or changed, its checksum does not match; {remedy}"
        )
    return {key: value for key, value in stored.items() if key not in head}


def check_regular(path: Path, remedy: str) -> None:
    """Refuse a pipe, a socket or a device, which would be waited for.

    Raises:
        InputError: if it is anything but a file or a folder, or does not exist.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; {remedy}")
    if not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: not a file but a pipe or a device; {remedy}")


def refuse_version(
    path: Path, format_name: str, stored_version: object, version: int, remedy: str
) -> NoReturn:
    """Raise the error of a file of another version."""
    raise InputError(
        f"{path}: a {format_name} of format version {stored_version}, and this version "
        f"of jaxthermo reads format version {version}; {remedy}"
    )


def arrays_checksum(arrays: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of the names, types, shapes and values of arrays, in any order."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def plain_checksum(content: Any) -> str:
    """SHA-256 of plain values; comments, line ends and the order of keys do not count.

    Raises:
        TypeError: for a value that JSON does not have.
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def text_hash(text: str) -> str:
    """Hash of a text by which configs are told apart [16 hex digits]."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def file_hash(path: Path) -> str:
    """SHA-256 of the content of a file, as hex digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def select_arrays(
    schema: type[_SchemaT], arrays: Mapping[str, np.ndarray], prefix: str = ""
) -> _SchemaT:
    """Pick and check the arrays of a schema.

    Args:
        schema: a NamedTuple whose annotations are jaxtyping's, such as
            `Float[np.ndarray, "s 3"]`: an axis of one name has one size. An array
            that may be missing has `| None`, and None as default.
        arrays: arrays by name.
        prefix: start of their names in `arrays`.

    Raises:
        InputError: naming the array that is missing, of another type or shape, or not
            finite; without a path and a remedy, which the caller knows.
    """
    selected = {}
    # One context binds the names of axes for all checks.
    with jaxtyped("context"):
        for name, expected in schema.__annotations__.items():
            array = arrays.get(prefix + name)
            if array is None:
                # An array that may be missing has None among its types.
                if isinstance(None, expected):
                    continue
                raise InputError(f"{prefix}{name} is missing")
            if not isinstance(array, expected):
                raise InputError(
                    f"{prefix}{name} is {array.dtype} of shape {array.shape}, and "
                    f"{_readable(expected)} is expected"
                )
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise InputError(f"{prefix}{name} has values that are not finite")
            selected[name] = array
    return schema(**selected)


def _readable(expected: Any) -> str:
    # Float[ndarray, "s 3"] reads as "Float [s 3]".
    alternatives = getattr(expected, "__args__", (expected,))
    return " or ".join(
        f"{alternative.__name__.split('[')[0]} [{alternative.dim_str}]"
        for alternative in alternatives
        if alternative is not type(None)
    )

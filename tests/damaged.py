"""Damaged files, the same ones for the same seed: bytes, numbers, lines, arrays, keys.

What a broken disk or download, an editor, another program or a slip of the hand makes.
"""

import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jaxthermo.archive import signed, write_archive


Random = np.random.Generator
_NUMBER = re.compile(rb"-?\d+(\.\d+)?(e-?\d+)?")
_ODD_NUMBERS = (
    *(b"nan", b"inf", b"-inf", b"0", b"-1", b"1e400", b"1e-300", b"1e9", b"-0.0"),
    *(b"", b"x", b"1.2.3", b"0x10", b"true", b"12345678901234567890", b"3 furlongs"),
    *(b"[]", b"{}", b"null", b"1,5", b"\xe4\xf6", b"\xc3\xa4", b"1e-9", b"0.5"),
)
_ODD_VALUES = (None, "x", [], {}, -1, 1e300, True, [[]], {"a": None}, 10**30, "\ud800")
_ODD_ARRAYS: tuple[Callable[[np.ndarray], np.ndarray | None], ...] = (
    lambda a: None,
    lambda a: a.T,
    lambda a: a[..., None],
    lambda a: a.reshape(-1)[: a.size // 2],
    lambda a: np.full(a.shape, np.nan),
    lambda a: np.full(a.shape, np.inf),
    lambda a: a.astype(complex),
    lambda a: np.array("text"),
    lambda a: -a.astype(float) * 1e30,
    lambda a: np.zeros(0),
    lambda a: np.concatenate([a.reshape(-1), a.reshape(-1)]),
    lambda a: (a.astype(np.int64) + 10**9).reshape(a.shape),
)


def _cut(data: bytes, random: Random) -> bytes:
    return data[: random.integers(len(data))]


def _flip(data: bytes, random: Random) -> bytes:
    changed = np.frombuffer(data, np.uint8).copy()
    count = int(random.integers(1, 9))
    places = random.integers(len(changed), size=count)
    changed[places] ^= (1 << random.integers(8, size=count)).astype(np.uint8)
    return changed.tobytes()


def _part(data: bytes, random: Random) -> tuple[int, int]:
    start = int(random.integers(len(data)))
    return start, min(len(data), start + int(random.integers(1, 200)))


def _zeros(data: bytes, random: Random) -> bytes:
    start, end = _part(data, random)
    return data[:start] + bytes(end - start) + data[end:]


def _remove(data: bytes, random: Random) -> bytes:
    start, end = _part(data, random)
    return data[:start] + data[end:]


def _repeat(data: bytes, random: Random) -> bytes:
    start, end = _part(data, random)
    return data[:end] + data[start:]


def _insert(data: bytes, random: Random) -> bytes:
    start, end = _part(data, random)
    return data[:start] + random.bytes(end - start) + data[start:]


def _halves(data: bytes, random: Random) -> bytes:
    start, _ = _part(data, random)
    return data[start:] + data[:start]


def _number(data: bytes, random: Random) -> bytes:
    numbers = list(_NUMBER.finditer(data))
    if not numbers:
        return _cut(data, random)
    start, end = numbers[random.integers(len(numbers))].span()
    return data[:start] + _ODD_NUMBERS[random.integers(len(_ODD_NUMBERS))] + data[end:]


def _line(data: bytes, random: Random) -> bytes:
    lines = data.split(b"\n")
    k, other_line = random.integers(len(lines), size=2)
    change = random.integers(4)
    if change == 0:
        del lines[k]
    elif change == 1:
        lines.insert(k, lines[other_line])
    elif change == 2:
        lines[k], lines[other_line] = lines[other_line], lines[k]
    else:
        lines[k] = b"  " + lines[k]
    return b"\n".join(lines)


def _word(data: bytes, random: Random) -> bytes:
    words = list(re.finditer(rb"[A-Za-z_]{2,}", data))
    if not words:
        return _cut(data, random)
    start, end = words[random.integers(len(words))].span()
    choice = random.integers(4)
    new = (b"", data[start : end - 1], b"\xff\xfe", data[start:end][::-1])[choice]
    return data[:start] + new + data[end:]


BYTES = (_cut, _flip, _zeros, _remove, _repeat, _insert, _halves)
TEXT = (_number, _number, _number, _line, _word, _cut, _flip, _remove)


def damage(data: bytes, random: Random, is_text: bool) -> bytes:
    """Content of a file with one kind of damage."""
    damages = TEXT if is_text else BYTES
    return damages[random.integers(len(damages))](data, random)


def damage_archive(path: Path, random: Random, file_kind: str, version: int) -> None:
    """Damage the bytes or an array of an `.npz` file, or write another valid one."""
    content = path.read_bytes()
    choice = random.integers(4)
    if choice == 0:
        path.write_bytes(damage(content, random, is_text=False))
        return
    with np.load(io.BytesIO(content)) as stored:
        arrays = dict(stored)
    names = sorted(arrays)
    name = names[random.integers(len(names))]
    changed = _changed(arrays.pop(name), random)
    if changed is not None:
        arrays[name] = changed
    if choice == 1:
        np.savez(path, **arrays)
        return
    # By another program, whose checksum is right.
    head = ("format", "format_version", "checksum")
    content_arrays = {key: value for key, value in arrays.items() if key not in head}
    write_archive(path, file_kind, version, content_arrays)


def _changed(array: np.ndarray, random: Random) -> np.ndarray | None:
    try:
        with np.errstate(all="ignore"):
            return _ODD_ARRAYS[random.integers(len(_ODD_ARRAYS))](array)
    except (TypeError, ValueError):  # a text has no numbers to change
        return np.zeros(3)


def damage_record(path: Path, random: Random, file_kind: str, version: int) -> None:
    """Damage the text or a value of a JSON file, or write another valid one."""
    content = path.read_bytes()
    choice = random.integers(3)
    if choice == 0:
        path.write_bytes(damage(content, random, is_text=True))
        return
    values = json.loads(content)
    parent, key = _somewhere(values, random)
    odd = random.integers(len(_ODD_VALUES) + 1)
    if odd == len(_ODD_VALUES):
        del parent[key]
    else:
        parent[key] = _ODD_VALUES[odd]
    if choice == 1:
        for name in ("format", "format_version", "checksum"):
            values.pop(name, None)
        values = signed(file_kind, version, values)
    path.write_text(json.dumps(values))


def _somewhere(values: Any, random: Random) -> tuple[Any, Any]:
    # A container within the values, and a key of it.
    while True:
        keys = list(values) if isinstance(values, dict) else list(range(len(values)))
        key = keys[random.integers(len(keys))]
        inner = values[key]
        deeper = isinstance(inner, dict | list) and inner and random.integers(4)
        if not deeper:
            return values, key
        values = inner

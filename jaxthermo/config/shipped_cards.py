"""Fit cards that are part of the package, named `card://BODY/STRUCTURE`."""

import re
from pathlib import Path

from ..errors import InputError
from .messages import close_match


SCHEME = "card://"
FOLDER = Path(__file__).parents[1] / "data" / "cards"
# A `Path` of it has lost a slash.
_PREFIX = re.compile(r"card:/+")


def shipped_cards() -> dict[str, Path]:
    """File of each shipped card by its name, such as "buddha/octree"."""
    files = sorted(FOLDER.glob("*/*.yaml"))
    return {f"{path.parent.name}/{path.stem}": path for path in files}


def is_shipped(source: str | Path) -> bool:
    """True for a name with `card://`."""
    return _PREFIX.match(str(source)) is not None


def card_path(source: str | Path) -> Path:
    """File of a card that is named by `card://NAME` or by its path.

    Raises:
        InputError: if no card of that name is shipped.
    """
    if not is_shipped(source):
        return Path(source)
    name = _PREFIX.sub("", str(source))
    cards = shipped_cards()
    if name not in cards:
        raise InputError(
            f"there is no shipped card '{SCHEME}{name}'{close_match(name, cards)}; "
            "`calibrate show --shipped` lists them"
        )
    return cards[name]


def card_name(path: Path) -> str:
    """Name of a card's file as a user writes it: `card://NAME`, or the path."""
    if FOLDER not in path.parents:
        return str(path)
    return SCHEME + path.relative_to(FOLDER).with_suffix("").as_posix()

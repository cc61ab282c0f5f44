"""Names of the frames of a run, and the frames of an earlier command."""

import re
from pathlib import Path

from ..errors import InputError


FRAMES = "frames"
CONTACTS = "contacts"
_FRAME_FILE = re.compile(r"t\d{6,}\.\d{2,}s(\.(exr|png|tiff|csv)|_centikelvin\.png)")
_MAX_DECIMALS = 9


def frame_names(times: list[float]) -> list[str]:
    """One name for each time [s], with as many decimals as make all names different.

    The names sort by time up to 999999 s.
    """
    for decimals in range(2, _MAX_DECIMALS):
        names = [f"t{time:0{7 + decimals}.{decimals}f}s" for time in times]
        if len(set(names)) == len(names):
            return names
    raise InputError(f"{len(times)} saved times are too close to name a frame by each")


def earlier_frames(folder: Path) -> set[Path]:
    """The frames of an earlier command; any other file is the user's own."""
    if not folder.is_dir():
        return set()
    return {p for p in folder.iterdir() if _FRAME_FILE.fullmatch(p.name)}

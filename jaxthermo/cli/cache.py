"""`jaxthermo cache`: what the user's cache holds, and its removal."""

from collections.abc import Sequence

from ..console.terminal import open_console, print_line
from ..errors import InputError
from ..host_memory import readable_bytes
from ..memo.store import OLD_RELEASE, Entry, cache_folder, clear, files_of, size_limit
from ..report.table import Table


_OLD_NOTE = (
    f"{OLD_RELEASE}: of an earlier release, not read: "
    f"`jaxthermo cache clear {OLD_RELEASE}` removes them."
)


def show_cache() -> None:
    """Print the folder, the limit, and the number and size of files by category.

    Raises:
        InputError: if the limit is no size.
    """
    console = open_console()
    limit = readable_bytes(size_limit())
    folder = cache_folder()
    if folder is None:
        print_line(console, "The cache is off: JAXTHERMO_CACHE=off.")
        return
    print_line(console, f"{folder}, limit {limit}")
    files = files_of(folder)
    rows = [
        _row(category, [file for file in files if file.category == category])
        for category in _categories(files)
    ]
    rows.append(_row("total", files))
    table = Table(("category", "files", "size"), rows, framed=False)
    console.print(table.rich())
    if OLD_RELEASE in _categories(files):
        print_line(console, _OLD_NOTE)


def _row(name: str, files: Sequence[Entry]) -> tuple[str, str, str]:
    size = sum(file.size for file in files)
    return name, f"{len(files):,}", readable_bytes(size)


def _categories(files: Sequence[Entry]) -> list[str]:
    return sorted({file.category for file in files})


def clear_cache(categories: tuple[str, ...]) -> None:
    """Remove the files of some categories, or all of them, and print their size.

    Raises:
        InputError: for a category without files, or a file that cannot be removed.
    """
    folder = cache_folder()
    files = [] if folder is None else files_of(folder)
    unknown = [name for name in categories if name not in _categories(files)]
    if unknown:
        choices = ", ".join(_categories(files)) or "nothing: the cache is empty"
        raise InputError(
            f"cache clear {unknown[0]}: there are no such files; choose {choices}"
        )
    removed = [file for file in files if not categories or file.category in categories]
    clear(removed)
    _, count, size = _row("removed", removed)
    print_line(open_console(), f"files removed: {count} ({size})")

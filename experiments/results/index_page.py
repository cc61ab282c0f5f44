"""`experiments report`: one page of all results in a folder."""

import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

from PIL import Image

from calibrate.study.rows import Row
from jaxthermo.errors import InputError
from jaxthermo.report import page
from jaxthermo.report.numbers import count, seconds, significant
from jaxthermo.report.table import Table, prose

from .changes import is_number
from .read import NOT_AS_WRITTEN, Damaged, Kind, Result


_INDEX = "index.html"
_TITLES: dict[Kind, str] = {
    "experiment": "Experiments",
    "sweep": "Sweeps",
    "plan": "Plans",
    "fit": "Fits",
    "reduced model": "Reduced models",
    "run": "Runs",
}
_PICTURE_WIDTH = 224
"""Width of a picture [px]: twice that on the page, for fine screens."""
_MAX_NUMBERS = 4
_FIXED_SPACE = "\N{NO-BREAK SPACE}"
_REPORTS = ("report.html", "front.html")


def write_index(folder: Path, found_results: Sequence[Result | Damaged]) -> Path:
    """Write the page into the folder, replacing an earlier one.

    Raises:
        InputError: if there is nothing to show, or the folder cannot be written.
    """
    if not found_results:
        raise InputError(f"{folder}: no result in it or below; name another folder")
    results = [result for result in found_results if isinstance(result, Result)]
    damaged = [result for result in found_results if isinstance(result, Damaged)]
    sections: list[page.Section] = []
    words = []
    for kind, title in _TITLES.items():
        of_kind = [result for result in results if result.kind == kind]
        if of_kind:
            # The newest first.
            of_kind.sort(key=lambda result: result.date, reverse=True)
            cards = [_card(folder, result) for result in of_kind]
            sections += [page.heading(title), page.cards(cards)]
            words.append(count(len(of_kind), title.lower().removesuffix("s")))
    if damaged:
        sections += [page.heading("Damaged or not finished"), _damaged(folder, damaged)]
    words += [f"{len(damaged)} damaged or not finished"] if damaged else []
    head = f"{', '.join(words)}; the newest of each kind first."
    path = folder / _INDEX
    title = f"Results in {folder.resolve().name}"
    page_sections = [page.paragraph(head, note=True), *sections]
    page.write_page(path, title, page_sections)
    return path


def _card(folder: Path, result: Result) -> page.Card:
    inside = result.folder.relative_to(folder)
    report = next((n for n in _REPORTS if (result.folder / n).is_file()), None)
    content = result.content
    code = [f"commit {content['commit']}"] if "commit" in content else []
    code += [f"config {result.config_hash}"] if result.config_hash else []
    origin = [f"{result.date:%Y-%m-%d %H:%M} UTC", str(content.get("processor", ""))]
    where = "" if str(inside) == "." else f"{inside}/"
    return page.Card(
        title=result.name,
        link=quote(f"{where}{report or result.file.name}"),
        lines=_figures(result),
        notes=[where or "this folder", _joined(origin), _joined(code)],
        png=_thumbnail(result.folder),
    )


def _joined(words: Sequence[str]) -> str:
    # A line breaks between the words and not within them.
    unbroken = (word.replace(" ", _FIXED_SPACE) for word in words if word)
    return " \N{MIDDLE DOT} ".join(unbroken)


def _damaged(folder: Path, damaged: Sequence[Damaged]) -> Table:
    rows = [
        [str(result.file.relative_to(folder)), prose(result.reason)]
        for result in damaged
    ]
    return Table(["file", "reason"], rows, left=(0, 1))


def _figures(result: Result) -> list[str]:
    lines: list[str] = []
    for figure in _FIGURES[result.kind]:
        # A figure that a version of the program did not write yet is left out.
        with suppress(*NOT_AS_WRITTEN):
            lines += filter(None, [figure(result)])
    return lines


def _run_size(result: Result) -> str:
    c = result.content
    return f"{c['nodes']:,} nodes, {c['steps']:,} steps, {seconds(c['run_time_s'])}"


def _run_temperatures(result: Result) -> str:
    temperatures = [body["surface_temperature_K"] for body in result.content["bodies"]]
    low = min(body["min"][-1] for body in temperatures)
    high = max(body["max"][-1] for body in temperatures)
    return f"surface {low:.2f} to {high:.2f} K at {result.content['times_s'][-1]:g} s"


def _run_truth(result: Result) -> str:
    error = result.content["truth_error"]
    return _error_words(error, "error against the truth")


def _error_words(error: Mapping[str, Any], subject: str) -> str:
    percent = error.get("worst_rms_percent")
    relative = "" if percent is None else f", {significant(percent)} %"
    return f"{subject}: {significant(error['worst_rms_kelvin'])} K{relative}"


def _fit_errors(result: Result) -> str:
    errors = result.content["error_percent"]
    words = {"train": "error fitted", "held_out": "held out"}
    return "; ".join(
        f"{words[group]} {significant(percent['default'])} to "
        f"{significant(percent['fitted'])}{_FIXED_SPACE}%"
        for group, percent in errors.items()
    )


def _fit_speed(result: Result) -> str:
    ratio = result.content["speedup"]["times_faster"]
    return f"{significant(ratio)} times faster than the full volume"


def _sweep_size(result: Result) -> str:
    failed = sum("failed" in row for row in result.rows)
    return count(len(result.rows), "case") + (f", {failed} failed" if failed else "")


def _sweep_best(result: Result) -> str:
    # By the worst load of each choice.
    done = [line for line in result.content["choices"] if "rms_kelvin" in line]
    best = min(done, key=lambda line: line["rms_kelvin"])
    percent = best["rms_percent"]
    relative = "" if percent is None else f", {significant(percent)}{_FIXED_SPACE}%"
    error = f"{significant(best['rms_kelvin'])}{_FIXED_SPACE}K{relative}"
    return f"smallest error: {error}, {_choice(best)}"


def _sweep_fastest(result: Result) -> str:
    timed = [line for line in result.content["choices"] if line.get("loop_s")]
    best = min(timed, key=lambda line: line["loop_s"])
    return f"fastest: {seconds(best['loop_s'])}, {_choice(best)}"


def _choice(line: Row) -> str:
    return ", ".join(f"{axis} {label}" for axis, label in line["choice"].items())


def _verdicts(result: Result) -> str:
    verdicts: dict[str, int] = result.body["verdicts"]
    return ", ".join(f"{n} {word}" for word, n in verdicts.items() if n)


def _sentences(result: Result) -> str:
    return "; ".join(islice(map(str, result.body["sentences"]), 2))


def _front(result: Result) -> str:
    # The front of a sweep begins with its cheapest choice.
    return "; ".join(row["sentence"] for row in result.body["front"][-2:])


def _plain_numbers(result: Result) -> str:
    # An experiment without sentences and verdicts: its first numbers.
    if {"verdicts", "sentences", "front"} & set(result.body):
        return ""
    numbers = (
        f"{key.replace('_', ' ')} {significant(value)}"
        for key, value in result.body.items()
        if is_number(value)
    )
    return ", ".join(islice(numbers, _MAX_NUMBERS))


def _plan_words(result: Result) -> str:
    # The first sentence says what was chosen.
    c = result.content
    return str(c["words"][0]) if c["chosen"] is not None else str(c["miss"])


def _table_size(result: Result) -> str:
    return count(len(result.body["table"]), "line") + " in its table"


def _reduced_size(result: Result) -> str:
    c = result.content
    offline = seconds(c["offline_s"])
    online = seconds(c["online_s"])
    return f"{c['size']} vectors, {offline} offline, {online} online"


def _reduced_error(result: Result) -> str:
    return _error_words(result.content["truth_error"], "error of the reduction")


_FIGURES: dict[Kind, tuple[Callable[[Result], str], ...]] = {
    "run": (_run_size, _run_temperatures, _run_truth),
    "fit": (_fit_errors, _fit_speed),
    "sweep": (_sweep_size, _sweep_best, _sweep_fastest),
    "experiment": (_sentences, _front, _verdicts, _table_size, _plain_numbers),
    "plan": (_plan_words,),
    "reduced model": (_reduced_size, _reduced_error),
}


def _thumbnail(folder: Path) -> bytes:
    """A small picture of a result, as a PNG; empty if it has none that can be read."""
    # The last frame of a run, else the picture that comes first by its name.
    frames = sorted(folder.glob("frames/*.png"))[-1:]
    pictures = sorted(folder.glob("pictures/*.png"))[:1]
    for file in [*frames, *sorted(folder.glob("*.png")), *pictures]:
        with suppress(OSError, ValueError), Image.open(file) as image:
            small = image.convert("RGB")
            small.thumbnail((_PICTURE_WIDTH, _PICTURE_WIDTH))
            stream = io.BytesIO()
            small.save(stream, "PNG", optimize=True)
            return stream.getvalue()
    return b""

"""Claims of the thesis beside what this run found."""

from typing import Any

from ..harness.record import Row
from .config import FULL, LINKS, LimbConfig
from .summary import Line
from .sweeps import ALL


Claim = dict[str, Any]

KEPT = 1e-6
"""Relative: capacities and means that agree to this are the same."""


def equilibrium_claim(rows: list[Row]) -> list[Claim]:
    """C11: the mean at the end, against the full volume's."""
    good = [row for row in rows if "refused" not in row]
    full = next((row for row in good if row["label"] == FULL), None)
    if full is None:
        return []
    numbers = [
        {
            "label": row["label"],
            "capacity_ratio": row["capacity_ratio"],
            "mean_off_relative": row["mean_K"] / full["mean_K"] - 1,
            "rise_off_relative": row["rise_K"] / full["rise_K"] - 1,
            "unevenness_relative": row["surface_range_K"] / full["rise_K"],
        }
        for row in good
    ]
    keeping = [n for n in numbers if abs(n["capacity_ratio"] - 1) < KEPT]
    worst = max(abs(n["rise_off_relative"]) for n in keeping)
    others = [n for n in numbers if n not in keeping]
    losing = ", ".join(
        f"{n['label']} {100 * n['rise_off_relative']:+.2g} %" for n in others
    )
    return [
        {
            "id": "C11",
            "claim": "an insulated body ends at the full volume's mean temperature",
            "holds": worst <= KEPT,
            "found": [
                f"rise of the mean off by at most {worst:.1g} of it in the "
                f"{len(keeping)} structures that keep the capacity",
                *([f"in those that do not: {losing}"] if losing else []),
            ],
            "numbers": numbers,
        }
    ]


def levels_claim(rows: list[Row]) -> list[Claim]:
    """C13: the more levels, the more precise."""
    numbers = [
        {
            "hollow": row["hollow"],
            "levels": row["levels"],
            "all": row["asked_for"] == ALL,
            "nodes": row["nodes"],
            "capacity_ratio": row["capacity_ratio"],
            "error_percent": row["error"]["worst_rms_percent"],
            "from_full_volume_percent": row["from_full_volume_at_the_same_step"][
                "worst_rms_percent"
            ],
        }
        for row in rows
        if "refused" not in row
    ]
    if not numbers:
        return []
    falls = all(
        later["from_full_volume_percent"] <= one["from_full_volume_percent"] + 1e-4
        for hollow in {n["hollow"] for n in numbers}
        for one, later in _pairs([n for n in numbers if n["hollow"] == hollow])
    )
    whole = max(n["from_full_volume_percent"] for n in numbers if n["all"])
    found = [
        f"hollow {hollow}, error by levels: {_by_levels(numbers, hollow)}"
        for hollow in dict.fromkeys(n["hollow"] for n in numbers)
    ]
    found.append(f"all levels: {whole:.1g} % from the full volume at the same step")
    return [
        {
            "id": "C13",
            "claim": "more levels are more precise, up to the full volume",
            "holds": falls and whole < 1e-3,
            "found": found,
            "numbers": numbers,
        }
    ]


def _by_levels(numbers: list[dict[str, Any]], hollow: str) -> str:
    here = [n for n in numbers if n["hollow"] == hollow]
    return ", ".join(f"{n['levels']}: {n['error_percent']:.3g} %" for n in here)


def _pairs(numbers: list[dict[str, Any]]):
    ordered = sorted(numbers, key=lambda n: n["levels"])
    return zip(ordered, ordered[1:], strict=False)


def limb_claim(local: list[Row], limb: LimbConfig) -> list[Claim]:
    """C14: where the levels do not reach the middle, the error is larger."""
    hollow = [row for row in local if None not in row["rms_kelvin"].values()]
    if not hollow:
        return []
    found = [
        f"{row['label']}: {row['rms_kelvin']['filled']:.2g} K where the levels fill "
        f"the body, {row['rms_kelvin']['hollow']:.2g} K where they do not"
        for row in hollow
    ]
    parts = [row["rms_kelvin"] for row in hollow]
    return [
        {
            "id": "C14",
            "claim": "holes inside break the multi-level structure (the sleeves)",
            "holds": all(part["hollow"] > part["filled"] for part in parts),
            "found": [f"{limb.shape.kind}, {limb.voxels_high} voxels high", *found],
            "numbers": local,
        }
    ]


THESIS_FASTER = {
    "multi_level": 1.10,
    "irregular_multi_level": 2.62,
    "single_shell": 4.23,
}
"""Table 6.1: 55 ms of the full volume over 50, 21 and 13 ms."""


def speed_claims(lines: list[Line]) -> list[Claim]:
    """C07 and C08: how much faster the thesis' structures are, a step and a run."""
    full = {line["body"]: line for line in lines if line["label"] == FULL}
    links = {line["body"]: line for line in lines if line["label"] == LINKS}
    found = []
    for line in lines:
        if line.get("kind") not in THESIS_FASTER or line["body"] not in full:
            continue
        whole, as_links = full[line["body"]], links.get(line["body"], {})
        found.append(
            {
                "body": line["body"],
                "label": line["label"],
                "thesis": THESIS_FASTER[line["kind"]],
                "a_run": line["times_faster"],
                "a_step": _a_step(line, whole),
                "a_step_of_links": _a_step(line, as_links),
                "worst_rms_percent": line["worst_rms_percent"],
            }
        )
    if not found:
        return []
    return [
        {
            "id": "C07, C08",
            "claim": "multi-level costs about what the full volume does (50 of 55 ms); "
            "irregular is 2.6 and the shell 4.2 times faster",
            "holds": None,
            "found": _speeds(found),
            "numbers": found,
        }
    ]


def _a_step(line: Line, full: Line) -> float | None:
    """Time of one step of the full volume over one of the structure."""
    if "refused" in full or not full:
        return None
    step = lambda one: one["run_time_s"]["median"] / one["steps"]
    return step(full) / step(line)


def _speeds(found: list[dict[str, Any]]) -> list[str]:
    return [
        f"{f['body']}, {f['label']} (thesis {f['thesis']:.2g}): "
        f"{f['a_run']['median']:.2g} ({f['a_run']['least']:.2g} to "
        f"{f['a_run']['most']:.2g}) a run, {f['a_step']:.2g} a step"
        + (
            f", {f['a_step_of_links']:.2g} a step of the full volume as links"
            if f["a_step_of_links"]
            else ""
        )
        + f"; error {f['worst_rms_percent']:.2g} %"
        for f in found
    ]


def path_claim(lines: list[Line]) -> list[Claim]:
    """C12: the longer way round in a shell distorts the transient."""
    found = []
    for body in dict.fromkeys(line["body"] for line in lines):
        # The first of a kind is the thesis' own; others differ in an option.
        errors: dict[str, float] = {}
        for line in lines:
            if line["body"] == body and line.get("kind") in THESIS_FASTER:
                errors.setdefault(line["kind"], line["worst_rms_percent"])
        if len(errors) == 3:
            found.append({"body": body, "error_percent": errors})
    if not found:
        return []
    in_order = [
        e["single_shell"] > e["multi_level"] > e["irregular_multi_level"]
        for e in (f["error_percent"] for f in found)
    ]
    words = [f"{f['body']}: {_listed(f['error_percent'])}" for f in found]
    return [
        {
            "id": "C12",
            "claim": "the error falls from shell to levels to irregular levels",
            "holds": all(in_order),
            "found": [*words, "with all weights 1"],
            "numbers": found,
        }
    ]


def _listed(errors: dict[str, float]) -> str:
    return ", ".join(f"{k.replace('_', ' ')} {v:.2g} %" for k, v in errors.items())


def capacity_claim(rows: list[Row]) -> list[Claim]:
    """C15: overlap and cracks change the capacity, unless it is kept."""
    numbers = []
    for row in rows:
        if "refused" in row or row["kind"] != "irregular_multi_level":
            continue
        report = row["structure"]
        numbers.append(
            {
                "body": row["body"],
                "label": row["label"],
                "keep_capacity": report["options"]["keep_capacity"],
                "capacity_ratio": row["capacity_ratio"],
                "share_of_body_volume": report["share_of_body_volume"],
            }
        )
    unique = list({(n["body"], n["label"]): n for n in numbers}.values())
    if not unique:
        return []
    kept = [n for n in unique if n["keep_capacity"]]
    return [
        {
            "id": "C15",
            "claim": "overlap and cracks between irregular levels change the capacity",
            "holds": all(abs(n["capacity_ratio"] - 1) < KEPT for n in kept)
            and any(
                abs(n["capacity_ratio"] - 1) > KEPT
                for n in unique
                if not n["keep_capacity"]
            ),
            "found": [
                f"{n['body']}, {n['label']}: {n['capacity_ratio']:.4f} of the body's"
                for n in unique
            ],
            "numbers": unique,
        }
    ]

"""What the thesis says of its structures, beside what this run found."""

from typing import Any

from .config import FULL, LimbConfig
from .levels import ALL
from .record import Row


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

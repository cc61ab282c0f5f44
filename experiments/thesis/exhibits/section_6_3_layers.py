"""Section 6.3: the layers of Happy Buddha and Max Planck, which do not fit 4.1."""

from ..bodies import NO_PLANCK, buddha, planck
from ..exhibit import Exhibit, Finding, Row, Verdict, skipped
from ..layers import count_by_height, count_table, layer_counts, shown


_HEIGHT = 250
_QUICK_HEIGHTS = (50, 100, 150, 200, 250)
_HEIGHTS = (*_QUICK_HEIGHTS, 350, 450, 550)
_BUDDHA, _PLANCK = (8, 14, 8), (4, 5, 4)
_BUDDHA_PEELED, _BUDDHA_PACKED = (18, 20, 8), (8, 11, 6)


def _measure(quick: bool) -> Finding:
    head, statue = planck(), buddha()
    if head is None:
        return skipped(NO_PLANCK)
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    table = [*count_by_height(head, heights), *count_by_height(statue, heights)]
    peeled, packed = layer_counts(head.grid(_HEIGHT, "dominant_axis"))
    peeled_b, packed_b = layer_counts(statue.grid(_HEIGHT, "dominant_axis"))
    found = any(list(_BUDDHA) in (row["peeled"], row["packed"]) for row in table)
    watertight = head.mesh.is_watertight
    reason = (
        f"Max Planck has {shown(peeled)} layers along x/y/z as peeled and "
        f"{shown(packed)} packed, the thesis {shown(_PLANCK)}. Its 5 cannot be peeled "
        "layers of a closed body, which a ray leaves as often as it enters: an odd "
        "number comes of packing, or of a scan with an open neck"
        + (", and our head is closed. " if watertight else ". ")
        + f"Its Buddha, {shown(_BUDDHA)}, is neither the {shown(_BUDDHA_PEELED)} nor "
        f"the {shown(_BUDDHA_PACKED)} of chapter 4, and "
        f"{'one' if found else 'no'} resolution below gives it. "
        "The order holds: the simpler head has fewer layers."
    )
    fewer = all(a <= b for a, b in zip(packed, packed_b, strict=True))
    own = (
        Verdict.REPRODUCED if fewer else Verdict.CONTRADICTED,
        f"Max Planck has {sum(packed)} packed layers, the {statue.name} "
        f"{sum(packed_b)}; as peeled {sum(peeled)} and {sum(peeled_b)}.",
    )
    rows = (
        Row("Max Planck as peeled, x/y/z", shown(_PLANCK), shown(peeled)),
        Row("Max Planck packed", shown(_PLANCK), shown(packed)),
        Row(f"{statue.name} as peeled", shown(_BUDDHA), shown(peeled_b)),
        Row(f"{statue.name} packed", shown(_BUDDHA), shown(packed_b)),
    )
    chosen = (
        *statue.stands_in,
        ("resolution", f"{_HEIGHT} voxels high; the thesis has 550 nearby, in 6.3"),
    )
    numbers = {
        "planck": {"peeled": list(peeled), "packed": list(packed)},
        "buddha": {"peeled": list(peeled_b), "packed": list(packed_b)},
        "by_height": table,
    }
    parts = (count_table(table),)
    return Finding(
        Verdict.DIFFERENT, reason, rows, {"C26": own}, chosen, parts, numbers
    )


EXHIBIT = Exhibit(
    name="section-6.3-layers",
    title="layers of Happy Buddha and Max Planck",
    place="6.3",
    claims=("C26",),
    measure=_measure,
)

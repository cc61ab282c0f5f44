"""Extrapolation of fit cards: where a scene is outside of the cases of a fit."""

from collections.abc import Mapping

from .weights import FitCard


def extrapolations(
    card: FitCard,
    numbers: Mapping[str, float],
    mechanisms: tuple[str, ...],
    geometry: tuple[str, str] | None = None,
    surface_cells: str = "",
) -> list[str]:
    """List where a scene is outside of the cases of a fit, one sentence each.

    Args:
        card: fit card of the weights that the scene uses.
        numbers: numbers of the scene, from `scene_numbers`.
        mechanisms: mechanisms of heat transfer in the scene.
        geometry: name and hash of the body's geometry, where they are known.
        surface_cells: of the body's voxels, where they are known.
    """
    sentences = _other_geometry(card, geometry)
    if surface_cells and card.surface_cells not in ("", surface_cells):
        fitted = f"the card was fitted with {card.surface_cells}"
        sentences.append(f"surface_cells {surface_cells}: {fitted}")
    for name, (low, high) in card.ranges.items():
        value = numbers.get(name)
        if value is None:
            continue
        if not low / card.tolerance <= value <= high * card.tolerance:
            words = name.replace("_", " ")
            span = range_words(card, name)
            sentences.append(f"{words} {value:.3g}: the card was fitted at {span}")
    new = [name for name in mechanisms if name not in card.mechanisms]
    if card.mechanisms and new:
        sentences.append(f"{', '.join(new)}: in no case that the card was fitted on")
    return sentences


def _other_geometry(card: FitCard, geometry: tuple[str, str] | None) -> list[str]:
    # A file may be renamed: its content counts.
    if geometry is None or not card.geometry or geometry[1] in card.geometry.values():
        return []
    name = geometry[0]
    fitted = ", ".join(card.geometry)
    content = ", with another content" if name in card.geometry else ""
    return [f"geometry {name}{content}: the card was fitted on {fitted}"]


def range_words(card: FitCard, name: str) -> str:
    """Range of one number of a card with its tolerance: "0.1 to 0.2 (a factor ..."."""
    low, high = card.ranges[name]
    span = f"{low:.3g} to {high:.3g}" if low < high else f"{low:.3g} only"
    return f"{span} (a factor of {card.tolerance:g} beyond counts as inside)"

"""Where a scene leaves what its fit cards were fitted on."""

from ..config.card_file import load_card
from ..config.schema.scene import SceneConfig
from ..scene.compile.compile import mechanism_names
from ..scene.dimensionless_groups import body_numbers
from ..scene.scene import Scene
from ..structures.fit_card import extrapolations


def card_warnings(config: SceneConfig, scene: Scene) -> list[str]:
    """A sentence for each number of a body that its card has not seen.

    Args:
        config: that names the cards.
        scene: made of it.
    """
    found = []
    for n, (given, body) in enumerate(zip(config.bodies, scene.bodies, strict=True)):
        path = given.structure.weights.card
        if path is None:
            continue
        numbers = body_numbers(scene, body, config.time.end)
        for words in extrapolations(load_card(path), numbers, mechanism_names(scene)):
            found.append(f"bodies.{n}: beyond the range of {path.name}: {words}")
    return found

"""Candidates of a plan: a pitch, a structure and a solver for all bodies of a scene."""

from typing import Any, Literal, NamedTuple, NotRequired, TypedDict

from jaxthermo.config.card_file import load_card
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.shipped_cards import SCHEME, shipped_cards
from jaxthermo.physics.contact.search import default_gap

from ..problem.reference import voxel_pitch
from ..problem.sheet_cells import resized_sheet


Family = Literal["full_volume", "aggregate", "octree", "shell_over_core", "sheet"]
Method = Literal["super_time_stepping", "forward_euler", "trbdf2"]

FAMILIES: tuple[Family, ...] = ("full_volume", "aggregate", "octree", "shell_over_core")
"""Families of solids; all bodies of the family "sheet" are sheets."""
_WORDS = {"full_volume": "full volume", "shell_over_core": "shell over a core"}
_METHOD_WORDS = {"super_time_stepping": "RKL2", "trbdf2": "TR-BDF2"}


class _SolverEntry(TypedDict):
    kind: Method
    dt: NotRequired[float]
    """Time step [s]."""


class Candidate(NamedTuple):
    """A model of a scene: the same for all of its bodies."""

    refinement: float
    """Pitch of the scene's file over that of the candidate [-]."""
    family: Family
    factor: int = 1
    """Voxels along an edge of a block; 1 where the family has no blocks."""
    card: str | None = None
    """Name of a shipped fit card."""
    method: Method = "super_time_stepping"
    steps: int = 36
    """Steps of the whole run; 0 for explicit steps as long as is stable."""

    @property
    def size(self) -> float:
        """Edge of a block over the pitch of the scene's file [-]."""
        return self.factor / self.refinement

    @property
    def line(self) -> tuple[str, str | None]:
        """Family and card: candidates of one line differ in sizes and steps only."""
        return self.family, self.card

    @property
    def structure(self) -> dict[str, Any]:
        """Entry `structure` of a body in a scene's file."""
        if self.card is not None:
            # All options of the structure that the weights are of.
            card = SCHEME + self.card
            return {**load_card(card).structure, "weights": {"card": card}}
        has_blocks = self.family in ("aggregate", "shell_over_core")
        blocks = {"factor": self.factor} if has_blocks else {}
        return {"kind": self.family, **blocks}

    def solver(self, end: float) -> _SolverEntry:
        """Entry `solver` of a scene's file for a run of `end` seconds."""
        if not self.steps:
            return {"kind": self.method}
        return {"kind": self.method, "dt": float(f"{end / self.steps:.6g}")}

    def words(self, pitches: tuple[float, ...]) -> str:
        """Description for people; `pitches` are those of the scene's file [m]."""
        voxels = [1e3 * pitch / self.refinement for pitch in pitches]
        listed = ", ".join(f"{mm:.3g}" for mm in dict.fromkeys(voxels))
        name = _WORDS.get(self.family, self.family)
        if self.family == "aggregate":
            blocks = ", ".join(
                f"{mm * self.factor:.3g}" for mm in dict.fromkeys(voxels)
            )
            text = f"blocks of {blocks} mm from {listed} mm voxels"
        elif self.family == "sheet":
            text = f"sheets in cells of {listed} mm"
        elif self.family == "shell_over_core":
            text = f"shell over a core of x{self.factor}, {listed} mm voxels"
        else:
            text = f"{name} of {listed} mm voxels"
        method = _METHOD_WORDS.get(self.method, "explicit Euler")
        steps = f", {self.steps} steps" if self.steps else ", stable steps"
        return f"{text}{', fitted' if self.card else ''}, {method}{steps}"

    def applied(self, scene: SceneConfig, pitches: tuple[float, ...]) -> SceneConfig:
        """Config of the scene with this model, checked.

        Args:
            scene: config of the scene's file.
            pitches: of its bodies [m].
        """
        plain = scene.model_dump(mode="json", exclude_none=True)
        for number, pitch in enumerate(pitches):
            config = scene.bodies[number]
            body = plain["bodies"][number]
            if config.wall is not None:
                # Its cells are as large as the blocks of solids.
                resized = resized_sheet(config, pitch * self.size, self.size)
                entry = resized.model_dump(mode="json", exclude_none=True)
                plain["bodies"][number] = entry
                continue
            body.pop("voxels_high", None)
            body["pitch"] = pitch / self.refinement
            body["structure"] = self.structure
            # Errors are those at the surface, with surface cells of second order.
            body["surface_map"] = {"kind": "flux_corrected", "at": "surface"}
            body["surface_cells"] = "crossings"
        for term in plain.get("terms", ()):
            # Its default follows the pitch: the bodies would touch less in finer ones.
            if term["kind"] == "contact":
                are_sheets = all(body.wall is not None for body in scene.bodies)
                term.setdefault("threshold", default_gap(pitches, are_sheets))
        plain["solver"] = self.solver(scene.time.last)
        plain.pop("truth", None)
        return SceneConfig.model_validate(plain)


def pitches_of(scene: SceneConfig) -> tuple[float, ...]:
    """Pitch of each body [m].

    Raises:
        InputError: for a body that has no finer or coarser voxels.
    """
    return tuple(voxel_pitch(n, body) for n, body in enumerate(scene.bodies))


def cards_of(scene: SceneConfig) -> tuple[Candidate, ...]:
    """Structures with a shipped fit card for the geometry of the scene's one body."""
    if len(scene.bodies) != 1:
        return ()
    name, content = scene.bodies[0].geometry
    candidates = []
    for key in shipped_cards():
        card = load_card(SCHEME + key)
        family = card.structure["kind"]
        if card.geometry.get(name) == content and family in FAMILIES:
            factor = int(card.structure.get("factor", 1))
            candidates.append(
                Candidate(refinement=1.0, family=family, factor=factor, card=key)
            )
    return tuple(candidates)

"""Bodies from the parts of one mesh file, by rules."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import ValidationError

from ...errors import InputError
from ...geometry.part_names import assign_rules, short_names
from ..types.model import Data, Mistake, MistakesError, Model, mistakes_in
from ..types.quantities import Flag, NotEmpty, PositiveLength, StartTemperature
from .body import BodyConfig, BodyOptions
from .geometry import MeshConfig
from .joints import JointsConfig
from .selection import Patterns


class _MatchConfig(Model):
    """The parts that a rule is for."""

    match: Patterns
    """Pattern of names, or a list of them: `*` stands for any characters, and one with
    a `/` is for the whole name node/mesh/material, another one for one of the three."""
    ignore: Flag = False
    """Leave these parts out."""


class RuleConfig(BodyOptions, _MatchConfig):
    """Rule for the parts of an assembly that no earlier rule matches."""

    temperature: StartTemperature | None = None
    """Temperature at the start, instead of that of the assembly [K]; or `steady`."""

    @classmethod
    def raw_mistakes(cls, data: Mapping[str, object]) -> list[Mistake]:
        """Keys of a rule that leaves its parts out."""
        if data.get("ignore") is not True:
            return []
        others = [key for key in data if key not in ("match", "ignore")]
        message = "parts that are ignored have no such key: remove it or `ignore`"
        return [((key,), message) for key in others if key in cls.model_fields]


class AssemblyConfig(Model):
    """Bodies from the parts of a mesh file: the first rule that matches a part counts.

    A body has the name of its node, or of the whole part where others have that too.
    """

    mesh: MeshConfig
    pitch: PositiveLength | None = None
    """Edge of the voxels and of the cells of sheets in rules without their own [m]."""
    temperature: StartTemperature | None = None
    """Temperature at the start [K]; `steady` for that of the steady state of the whole
    scene with the values of its start. That of the scene if not given."""
    parts: Annotated[tuple[RuleConfig, ...], NotEmpty]
    """The rules; `jaxthermo parts FILE --scene` writes some to begin with."""
    joints: JointsConfig | None = None
    """Conduction between parts that touch: the `joints` of the scene."""

    def mistakes(self) -> list[Mistake]:
        """A part in `mesh`, which has all of them."""
        if self.mesh.part is None:
            return []
        return [(("mesh", "part"), "an assembly has all parts: give it in a body")]


def with_assembly(data: Data, context: Any) -> Data:
    """The data with the bodies of the assembly after the others, instead of it.

    Raises:
        MistakesError: for an assembly that is wrong, or does not fit to its file.
    """
    try:
        of_assembly = _bodies_of_assembly(data["assembly"], context)
    except MistakesError as error:
        located = [(("assembly", *where), line) for where, line in error.mistakes]
        raise MistakesError(located) from error
    bodies = data.get("bodies") or []
    if not isinstance(bodies, list):
        return data
    if not bodies and not of_assembly:
        message = "all parts are ignored, and a scene needs a body"
        raise MistakesError([(("assembly", "parts"), message)])
    others = {key: value for key, value in data.items() if key != "assembly"}
    joints = data["assembly"].get("joints")
    if joints is not None:
        if others.get("joints") is not None:
            message = "the scene has `joints` too: give one of them"
            raise MistakesError([(("assembly", "joints"), message)])
        others["joints"] = joints
    return {**others, "bodies": [*bodies, *of_assembly]}


def _bodies_of_assembly(raw: Any, context: Any) -> list[Data]:
    """The bodies of an assembly, as they would be written under `bodies`.

    Args:
        raw: the assembly as it is in the file.
        context: of the validation.

    Raises:
        MistakesError: for an assembly that is wrong, or does not fit to its file.
    """
    try:
        assembly = AssemblyConfig.model_validate(raw, context=context)
        parts = assembly.mesh.placed_parts()
    except ValidationError as error:
        raise MistakesError(mistakes_in(error)) from error
    except InputError as error:
        raise MistakesError([(("mesh",), str(error))]) from error
    names = dict(zip(parts, short_names(list(parts)), strict=True))
    assigned = assign_rules([rule.match for rule in assembly.parts], names)
    mistakes: list[Mistake] = [
        (
            ("parts",) if fault.rule is None else ("parts", fault.rule, "match"),
            fault.line,
        )
        for fault in assigned.faults
    ]
    bodies = []
    examined = set()
    for label, number in assigned.rule_of.items():
        rule = assembly.parts[number]
        if rule.ignore:
            continue
        if not parts[label].mesh.has_extent:
            remedy = f"{{match: {names[label]!r}, ignore: true}}"
            message = f"the part {label!r} has no extent: leave it out by {remedy}"
            mistakes.append((("mesh",), message))
            continue
        body = _body(raw, number=number, rule=rule, label=label, name=names[label])
        bodies.append(body)
        if number not in examined:
            examined.add(number)
            mistakes += _mistakes_of_rule(body, number, context)
    if mistakes:
        raise MistakesError(mistakes)
    return bodies


def _body(raw: Any, *, number: int, rule: RuleConfig, label: str, name: str) -> Data:
    """The body of a part as the file would have it."""
    own = raw["parts"][number]
    body = {k: v for k, v in own.items() if k not in _MatchConfig.model_fields}
    body["name"] = name
    body["mesh"] = {**raw["mesh"], "part": label}
    if body.get("temperature") is None and "temperature" in raw:
        body["temperature"] = raw["temperature"]
    pitch = raw.get("pitch")
    if pitch is None:
        return body
    if rule.sheet is None and rule.pitch is None and rule.voxels_high is None:
        body["pitch"] = pitch
    if rule.sheet is not None and rule.sheet.pitch is None:
        body["sheet"] = {**own["sheet"], "pitch": pitch}
    return body


def _mistakes_of_rule(
    body: Mapping[str, Any], number: int, context: Any
) -> list[Mistake]:
    """Mistakes of the body of a rule, at the keys of the rule or of the assembly."""
    try:
        BodyConfig.model_validate(body, context=context)
    except ValidationError as error:
        mistakes = mistakes_in(error)
    else:
        return []
    located = []
    for location, message in mistakes:
        if location == ("temperature",) and "temperature" not in body:
            located.append((location, message))
        else:
            located.append((("parts", number, *location), message))
    return located

"""Unions of models that are told apart by their `kind`."""

from typing import Any

from pydantic import BeforeValidator

from .model import Model


def by_kind(value: Any) -> str | None:
    """The tag of a union's member: its `kind`, in brackets that no key has."""
    held = (
        value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    )
    return None if held is None else f"<{held}>"


def short_kind(default: str) -> BeforeValidator:
    """Lets a word alone stand for `{kind: word}`; without `kind` it is the default."""

    def spell_out(value: Any) -> Any:
        if isinstance(value, str):
            return {"kind": value}
        return {"kind": default, **value} if isinstance(value, dict) else value

    return BeforeValidator(spell_out)


class KindModel(Model):
    """A member of a union whose members take different keys."""

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """What this kind takes: the key may be another kind's."""
        kind = cls.model_fields["kind"].default
        takes = [name for name in cls.model_fields if name != "kind"]
        return f"unknown key: {kind} takes {', '.join(takes) or 'no other keys'}"

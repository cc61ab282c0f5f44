"""Equal objects as one object, for as long as it is in use.

Findings belong to objects, by their identity. Bodies made from equal inputs, as fifty
bolts or those of a script that runs again, share them because they share the object.
"""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar
from weakref import WeakValueDictionary

from .content_hash import content_hash
from .values import NoContentError


_T = TypeVar("_T")

_objects: WeakValueDictionary[Hashable, Any] = WeakValueDictionary()


def shared(category: str, inputs: Any, make: Callable[[], _T]) -> _T:
    """Return the object that was made from equal inputs, if it is still in use.

    Args:
        category: name of such objects, in lower case.
        inputs: everything that the object follows from, as those of `stored`. With
            anything else it is made again.
        make: makes the object, which never changes.
    """
    try:
        key = category, content_hash(inputs)
    except NoContentError:
        return make()
    known = _objects.get(key)
    return _objects.setdefault(key, make()) if known is None else known

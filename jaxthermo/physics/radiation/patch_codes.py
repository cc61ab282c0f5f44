"""Patches by the codes of their cells and sides, for points on surfaces."""

import threading
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Int


class CodedPatches(NamedTuple):
    """Patches of some codes, which increase."""

    code: Int[np.ndarray, " p"]
    patch: Int[np.ndarray, " p"]

    def slot(self, code: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Place of each code, or of any other if it is missing."""
        return np.minimum(np.searchsorted(self.code, code), len(self.code) - 1)

    def joined(self, other: "CodedPatches") -> "CodedPatches":
        """These and others; of two with one code the first counts."""
        both = np.append(self.code, other.code)
        code, first = np.unique(both, return_index=True)
        return CodedPatches(code, np.append(self.patch, other.patch)[first])


class PatchesByCode:
    """Patch of each code; codes without a patch of their own are added when met."""

    def __init__(self, known: CodedPatches):
        # One value, so that no thread reads codes with the patches of others.
        self._known = known
        self._adding = threading.Lock()

    def patches(
        self,
        code: Int[np.ndarray, " n"],
        find: Callable[[Int[np.ndarray, " m"]], CodedPatches],
    ) -> Int[np.ndarray, " n"]:
        """Patch of each code.

        `find` returns new codes and their patches from the indices of codes without.
        """
        known = self._known
        slot = known.slot(code)
        missing = np.flatnonzero(known.code[slot] != code)
        if not len(missing):
            return known.patch[slot]
        added = find(missing)
        with self._adding:
            known = self._known.joined(added)
            self._known = known
        return known.patch[known.slot(code)]

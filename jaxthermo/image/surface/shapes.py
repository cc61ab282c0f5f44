"""Shapes of the bodies of an image: equal bodies share one, one search serves all."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from ...geometry.mesh import joined
from ...memo.found import found
from ...scene.scene import BodyGeometry, SolvedSurface


@dataclass(frozen=True, eq=False)
class Shapes:
    """Meshes and fragments of n shapes, one after the other, each in its own frame."""

    vertices: Float[np.ndarray, "v 3"]
    """[m]"""
    faces: Int[np.ndarray, "f 3"]
    """See `BodyGeometry.surface_faces`."""
    face_count: Int[np.ndarray, " n"]
    fragment_position: Float[np.ndarray, "s 3"]
    """[m]"""
    fragment_normal: Float[np.ndarray, "s 3"]
    fragment_area: Float[np.ndarray, " s"]
    """[m^2]"""
    fragment_count: Int[np.ndarray, " n"]
    pitch: Float[np.ndarray, " n"]
    """[m]"""
    is_two_sided: Bool[np.ndarray, " n"]
    """True for a thin wall."""

    @classmethod
    def of(cls, geometries: tuple[BodyGeometry, ...]) -> "Shapes":
        """Shapes of bodies; the same object in every call."""
        arrays = [array for geometry in geometries for array in _arrays(geometry)]
        numbers = tuple((float(g.pitch), g.is_two_sided) for g in geometries)
        return found(
            tuple(arrays), ("shapes", numbers), lambda: cls._joined(geometries)
        )

    @classmethod
    def _joined(cls, geometries: tuple[BodyGeometry, ...]) -> "Shapes":
        vertices, faces = joined([(g.vertices, g.surface_faces) for g in geometries])
        return cls(
            vertices=vertices,
            faces=faces,
            face_count=np.array([len(g.surface_faces) for g in geometries]),
            fragment_position=_concatenated([g.fragment_position for g in geometries]),
            fragment_normal=_concatenated([g.fragment_normal for g in geometries]),
            fragment_area=_concatenated([g.fragment_area for g in geometries]),
            fragment_count=np.array([len(g.fragment_area) for g in geometries]),
            pitch=np.array([g.pitch for g in geometries], float),
            is_two_sided=np.array([g.is_two_sided for g in geometries]),
        )

    @property
    def first_face(self) -> Int[np.ndarray, " n"]:
        """Number of the first triangle of each shape."""
        return np.cumsum(self.face_count) - self.face_count

    @property
    def first_fragment(self) -> Int[np.ndarray, " n"]:
        """Number of the first fragment of each shape."""
        return np.cumsum(self.fragment_count) - self.fragment_count

    @property
    def of_face(self) -> Int[np.ndarray, " f"]:
        """Number of the shape of each triangle."""
        return np.repeat(np.arange(len(self.pitch)), self.face_count)

    @property
    def of_fragment(self) -> Int[np.ndarray, " s"]:
        """Number of the shape of each fragment."""
        return np.repeat(np.arange(len(self.pitch)), self.fragment_count)


class ShapePoints(NamedTuple):
    """Points at surfaces, in the frames of their shapes."""

    shape: Int[np.ndarray, " p"]
    """Number of the shape."""
    position: Float[np.ndarray, "p 3"]
    """[m]"""
    normal: Float[np.ndarray, "p 3"]
    """Unit vectors."""

    @classmethod
    def of_one(
        cls, position: Float[np.ndarray, "p 3"], normal: Float[np.ndarray, "p 3"]
    ) -> "ShapePoints":
        """Points at the first shape."""
        return cls(np.zeros(len(position), np.int64), position, normal)

    def some(self, which: Int[np.ndarray, " q"]) -> "ShapePoints":
        """Some of the points."""
        return ShapePoints(*(column[which] for column in self))


class Bodies(NamedTuple):
    """Shapes and places of b bodies."""

    shapes: Shapes
    shape: Int[np.ndarray, " b"]
    """Number of the shape of each body."""
    rotation: Float[np.ndarray, "b 3 3"]
    """From the body to the world."""
    translation: Float[np.ndarray, "b 3"]
    """[m]"""

    @classmethod
    def of(cls, surfaces: tuple[SolvedSurface, ...]) -> "Bodies":
        """Those of solved surfaces, which share equal shapes."""
        geometries = [surface.geometry for surface in surfaces]
        keys = [(*map(id, _arrays(g)), g.pitch, g.is_two_sided) for g in geometries]
        distinct = dict(zip(keys, geometries, strict=True))
        number = {key: n for n, key in enumerate(distinct)}
        poses = [geometry.placed for geometry in geometries]
        return cls(
            shapes=Shapes.of(tuple(distinct.values())),
            shape=np.array([number[key] for key in keys]),
            rotation=np.array([pose.rotation for pose in poses], float),
            translation=np.array([pose.translation for pose in poses], float),
        )

    def to_body(
        self, points: Float[np.ndarray, "p 3"], body: Int[np.ndarray, " p"]
    ) -> Float[np.ndarray, "p 3"]:
        """Transform points from the world to their bodies [m]."""
        return self.rotate_back(points - self.translation[body], body)

    def to_world(
        self, points: Float[np.ndarray, "p 3"], body: Int[np.ndarray, " p"]
    ) -> Float[np.ndarray, "p 3"]:
        """Transform points from their bodies to the world [m]."""
        return self.rotate(points, body) + self.translation[body]

    def rotate(
        self, vectors: Float[np.ndarray, "p 3"], body: Int[np.ndarray, " p"]
    ) -> Float[np.ndarray, "p 3"]:
        """Rotate directions from their bodies to the world."""
        return np.einsum("pj,pij->pi", vectors, self.rotation[body])

    def rotate_back(
        self, vectors: Float[np.ndarray, "p 3"], body: Int[np.ndarray, " p"]
    ) -> Float[np.ndarray, "p 3"]:
        """Rotate directions from the world to their bodies."""
        return np.einsum("pi,pij->pj", vectors, self.rotation[body])

    def face_of(
        self, face: Int[np.ndarray, " p"], body: Int[np.ndarray, " p"]
    ) -> Int[np.ndarray, " p"]:
        """Numbers among the triangles of all shapes, from those in the bodies."""
        return face + self.shapes.first_face[self.shape[body]]

    def of_fragments(
        self, weights: csr_array, body: Int[np.ndarray, " p"]
    ) -> csr_array:
        """Weights of the fragments of all bodies, from those of all shapes.

        Each row has the body to whose fragments its weights belong.
        """
        count = self.shapes.fragment_count[self.shape]
        first = np.cumsum(count) - count
        shift = first - self.shapes.first_fragment[self.shape]
        columns = weights.indices
        if shift.any():
            columns = columns + np.repeat(shift[body], np.diff(weights.indptr))
        size = len(body), int(count.sum())
        return csr_array((weights.data, columns, weights.indptr), size)


def _arrays(geometry: BodyGeometry) -> tuple[np.ndarray, ...]:
    """Arrays that bodies of one shape share."""
    mesh = geometry.vertices, geometry.faces
    fragments = geometry.fragment_position, geometry.fragment_normal
    return *mesh, *fragments, geometry.fragment_area


def _concatenated(arrays: list[np.ndarray]) -> np.ndarray:
    """One array of all; that of a single shape without a copy."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)

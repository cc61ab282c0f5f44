"""VTU files, the unstructured grids of ParaView, and their PVD collection over time.

The writer of meshio leaves out the field data, where ParaView finds the time.
"""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from jaxtyping import Float, Int

from ...atomic import write_text


_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
# The format's number of a triangle.
_TRIANGLE = 5


def write_triangles(
    path: str | Path,
    points: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    point_data: Mapping[str, np.ndarray],
    cell_data: Mapping[str, np.ndarray],
    time: float | None = None,
    names: Sequence[str] = (),
) -> None:
    """Write triangles with values at their points and in their cells.

    Args:
        path: of the file.
        points: in the world [m].
        faces: of the mesh.
        point_data: a value or a vector of each point, by a name with its unit.
        cell_data: a value or a vector of each face, by name.
        time: of the values [s].
        names: of the bodies, in the order of their numbers: a field each.

    Raises:
        InputError: if the file cannot be written.
    """
    offsets = 3 * np.arange(1, len(faces) + 1, dtype=np.int64)
    cells = {
        "connectivity": np.asarray(faces, np.int64).ravel(),
        "offsets": offsets,
        "types": np.full(len(faces), _TRIANGLE, np.uint8),
    }
    fields = {name: np.array([number]) for number, name in enumerate(names)}
    if time is not None:
        fields["TimeValue"] = np.array([time])
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">',
        "<UnstructuredGrid>",
        *_section("FieldData", fields, ' NumberOfTuples="1"'),
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(faces)}">',
        *_section("Points", {"Points": np.asarray(points, np.float32)}),
        *_section("Cells", cells),
        *_section("PointData", point_data),
        *_section("CellData", cell_data),
        "</Piece>",
        "</UnstructuredGrid>",
        "</VTKFile>",
    ]
    write_text(path, "\n".join(lines) + "\n")


def _section(name: str, arrays: Mapping[str, np.ndarray], also: str = "") -> list[str]:
    arrays_xml = [_array(key, np.asarray(value), also) for key, value in arrays.items()]
    return [f"<{name}>", *arrays_xml, f"</{name}>"]


def _array(name: str, values: np.ndarray, also: str) -> str:
    values = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    type_name = _TYPES[f"{values.dtype.kind}{values.dtype.itemsize}"]
    columns = f'NumberOfComponents="{values.shape[1]}" ' if values.ndim == 2 else ""
    size = np.array([values.nbytes], "<u8").tobytes()
    text = base64.b64encode(size + values.tobytes()).decode("ascii")
    return (
        f"<DataArray type={quoteattr(type_name)} Name={quoteattr(name)} "
        f'{columns}format="binary"{also}>{text}</DataArray>'
    )


def write_pvd(path: str | Path, files: Sequence[tuple[float, str]]) -> None:
    """Write a collection of VTU files in the same folder, by their times [s].

    Raises:
        InputError: if the file cannot be written.
    """
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "<Collection>",
        *(
            f'<DataSet timestep="{time:.9g}" part="0" file={quoteattr(name)}/>'
            for time, name in files
        ),
        "</Collection>",
        "</VTKFile>",
    ]
    write_text(path, "\n".join(lines) + "\n")

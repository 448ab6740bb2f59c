"""Outlines as DXF files for CAD and measuring machines, meshed bodies as VTK files for ParaView."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import import_extra

RELEASE = "R2010"
COLOURS = (7, 1)
"""Of the layers by their order, in AutoCAD's index: black or white, and red."""


def outlines_dxf(outlines: Mapping[str, NDArray]) -> bytes:
    """A drawing in millimetres with one closed polyline on a layer of each name.

    Parameters
    ----------
    outlines : layer -> corners (n_points,) complex [mm] in order, the first not repeated.

    Raises
    ------
    InputError : ezdxf is not installed.
    """
    ezdxf = import_extra("ezdxf", "cad")
    former_option, ezdxf.options.write_fixed_meta_data_for_testing = (
        ezdxf.options.write_fixed_meta_data_for_testing,
        True,
    )
    try:  # equal outlines give equal bytes: neither time nor a random number is written
        document = ezdxf.new(RELEASE)
        document.units = ezdxf.units.MM
        for number, (layer, corners) in enumerate(outlines.items()):
            document.layers.add(layer, color=COLOURS[number % len(COLOURS)])
            points = list(zip(corners.real.tolist(), corners.imag.tolist(), strict=True))
            document.modelspace().add_lwpolyline(points, close=True, dxfattribs={"layer": layer})
        text = io.StringIO()
        document.write(text)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = former_option
    return text.getvalue().encode()


def write_vtk(
    path: Path, nodes: NDArray[np.complex128], triangles: NDArray[np.intp], point_data: Mapping[str, NDArray]
) -> None:
    """Write quadratic triangles and fields on their nodes.

    Parameters
    ----------
    path
        File to write; its suffix is the format: ``.vtu`` (compressed) or ``.vtk``.
    nodes
        (n_nodes,) complex [mm].
    triangles
        Nodes of every triangle (n_triangles, 6): corners, then the midpoints of edges 01, 12, 20, as in VTK.
    point_data
        Fields by name with the unit in it, ``displacement_um``: scalars (n_nodes,), or vectors (n_nodes,) complex,
        written with a third component of 0 so that ParaView can warp by them.

    Raises
    ------
    ValueError
        A field does not hold one value a node.
    InputError
        meshio is not installed.
    """
    meshio = import_extra("meshio", "vtk")  # slow to import, and few runs mesh
    for name, field in point_data.items():
        if np.shape(field) != nodes.shape:
            raise ValueError(f"field {name} has shape {np.shape(field)}; must be {nodes.shape}, one value a node")
    fields = {name: _in_space(field) if np.iscomplexobj(field) else field for name, field in point_data.items()}
    meshio.Mesh(_in_space(nodes), [("triangle6", triangles)], point_data=fields).write(path)


def _in_space(vectors: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.stack([vectors.real, vectors.imag, np.zeros(len(vectors))], axis=-1)

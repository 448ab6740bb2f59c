"""The condensed disk: its mesh, the patches, and how one pin's force deflects it."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from pipeline.arrays import Complex, Index, Real
from pipeline.errors import import_extra
from pipeline.figures import style

PATCH_PITCHES_SHOWN = 1.05
"""Half width of the close-up in distances between neighbouring patches."""
HOLE_PATCHES_SHOWN = 2.5
"""Half width of the close-up of a hole in widths of its patch."""
NO_HOLES = np.zeros((0, 0), complex)


@style.with_style
def mesh_figure(
    nodes: Complex, triangles: Index, patch_points: Complex, displacement: Complex, hole_points: Complex = NO_HOLES
) -> Figure:
    """Whole disk with the size of its deflection, and close-ups of the flank at the loaded pin, and of a hole.

    Parameters
    ----------
    nodes : (n_nodes,) [mm], x + iy
    triangles : (n_triangles, 6), corners first
    patch_points : (n_patches, n_points) [mm], where the pressure is applied
    displacement : (n_nodes,) [um/N], by 1 N on the pin of the longest arm
    hole_points : (n_holes, n_points) [mm], those of ``patch_points`` on the walls of holes
    """
    figure, (overview, close, *hole_axes) = _panels(len(hole_points) > 0)
    plane = Triangulation(nodes.real, nodes.imag, triangles[:, :3])
    size = np.abs(displacement)
    shading = overview.tripcolor(plane, size, shading="gouraud", cmap="viridis", rasterized=True)
    scale = figure.colorbar(shading, ax=overview, label="deflection by 1 N on one pin (µm/N)", shrink=0.85)
    scale.outline.set_visible(False)
    centres = patch_points.mean(axis=1)
    loaded_patch = _loaded_patch(nodes, centres, size)
    distance = np.abs(centres - centres[loaded_patch])
    reach = PATCH_PITCHES_SHOWN * float(np.min(distance[distance > 0]))
    corner = centres[loaded_patch] - reach * (1 + 1j)
    side = 2 * reach
    overview.add_patch(
        Rectangle((corner.real, corner.imag), side, side, fill=False, edgecolor=style.INK, linewidth=1.2)
    )
    _draw_flank(close, plane, patch_points, loaded_patch, reach)
    overview.set_title(f"{len(triangles):,} quadratic triangles, {len(nodes):,} nodes")
    close.set_title("Flank at the loaded pin")
    for patch in hole_points:
        overview.plot(patch.real, patch.imag, color=style.ALARM, linewidth=2.0)
    for axes in hole_axes:
        _draw_hole(axes, plane, hole_points)
    for axes in (overview, close, *hole_axes):
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.grid(False)
    return figure


def _panels(holes: bool) -> tuple[Figure, list[Axes]]:
    """The figure and its panels: whole disk, flank, and with holes a hole's wall."""
    if not holes:
        figure = style.new_figure(4.1)
        return figure, list(figure.subplots(1, 2, width_ratios=[1.14, 1]))
    figure = style.new_figure(5.6)
    panels: dict[str, Axes] = figure.subplot_mosaic([["whole", "close"], ["whole", "hole"]], width_ratios=[1.45, 1])
    return figure, [panels[name] for name in ("whole", "close", "hole")]


def _draw_triangles(axes: Axes, plane: Triangulation, centre: complex, reach: float) -> None:
    """The triangles within ``reach`` [mm] of a point, which the axes then show."""
    corners = plane.x[plane.triangles] + 1j * plane.y[plane.triangles] - centre
    visible = np.min(np.maximum(np.abs(corners.real), np.abs(corners.imag)), axis=1) < reach
    axes.triplot(Triangulation(plane.x, plane.y, plane.triangles[visible]), color="0.7", linewidth=0.5)
    axes.set(xlim=(centre.real - reach, centre.real + reach), ylim=(centre.imag - reach, centre.imag + reach))


def _draw_hole(axes: Axes, plane: Triangulation, hole_points: Complex) -> None:
    """The triangles about the first hole's patch."""
    points = hole_points[0]
    _draw_triangles(axes, plane, points.mean(), HOLE_PATCHES_SHOWN * float(np.ptp(np.abs(points - points[0]))))
    axes.plot(points.real, points.imag, color=style.ALARM, linewidth=4.0, solid_capstyle="butt")
    axes.set_title("Hole 0")


def _loaded_patch(nodes: Complex, centres: Complex, size: Real) -> int:
    """The patch that deflects most: that of the loaded pin."""
    nearest_nodes = [int(np.argmin(np.abs(nodes - centre))) for centre in centres]
    return int(np.argmax(size[nearest_nodes]))


def _draw_flank(axes: Axes, plane: Triangulation, patch_points: Complex, loaded_patch: int, reach: float) -> None:
    """The triangles and patches within ``reach`` [mm] of the loaded patch."""
    centre = patch_points[loaded_patch].mean()
    _draw_triangles(axes, plane, centre, reach)
    patches_shown = np.flatnonzero(np.min(np.abs(patch_points - centre), axis=1) < 2 * reach)
    neighbours = patches_shown[patches_shown != loaded_patch]
    for numbers, colour, label in (
        (neighbours, style.ACCENT, "contact patches"),
        ([loaded_patch], style.ALARM, "of the loaded pin"),
    ):
        points = patch_points[numbers].T
        lines = axes.plot(points.real, points.imag, color=colour, linewidth=4.0, solid_capstyle="butt")
        lines[0].set_label(label)
    # the corner that points away from the disk is empty
    legend_corner = f"{'upper' if centre.imag > 0 else 'lower'} {'right' if centre.real > 0 else 'left'}"
    axes.legend(loc=legend_corner, frameon=True, framealpha=1.0, edgecolor="none")


RELEASE = "R2010"
COLOURS = (7, 1)
"""Of the layers by their order, in AutoCAD's index: black or white, and red."""


def outlines_dxf(outlines: Mapping[str, NDArray[Any]]) -> bytes:
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


def write_vtk(path: Path, nodes: Complex, triangles: Index, point_data: Mapping[str, NDArray[Any]]) -> None:
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


def _in_space(vectors: Complex) -> Real:
    return np.stack([vectors.real, vectors.imag, np.zeros(len(vectors))], axis=-1)

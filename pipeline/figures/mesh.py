"""The condensed disk: its mesh, the patches, and how one pin's force deflects it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from pipeline.figures.style import ACCENT, ALARM, INK, new_figure, with_style

PATCH_PITCHES_SHOWN = 1.05
"""Half width of the close-up in distances between neighbouring patches."""
HOLE_PATCHES_SHOWN = 2.5
"""Half width of the close-up of a hole in widths of its patch."""
NO_HOLES = np.zeros((0, 0), complex)


@with_style
def mesh_figure(
    nodes: NDArray[np.complex128],
    triangles: NDArray[np.intp],
    patch_points: NDArray[np.complex128],
    displacement: NDArray[np.complex128],
    hole_points: NDArray[np.complex128] = NO_HOLES,
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
    overview.add_patch(Rectangle((corner.real, corner.imag), side, side, fill=False, edgecolor=INK, linewidth=1.2))
    _draw_flank(close, plane, patch_points, loaded_patch, reach)
    overview.set_title(f"{len(triangles):,} quadratic triangles, {len(nodes):,} nodes")
    close.set_title("Flank at the loaded pin")
    for patch in hole_points:
        overview.plot(patch.real, patch.imag, color=ALARM, linewidth=2.0)
    for axes in hole_axes:
        _draw_hole(axes, nodes, triangles, hole_points)
    for axes in (overview, close, *hole_axes):
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.grid(False)
    return figure


def _panels(holes: bool) -> tuple[Figure, list[Axes]]:
    """The figure and its panels: whole disk, flank, and with holes a hole's wall."""
    if not holes:
        figure = new_figure(4.1)
        return figure, list(figure.subplots(1, 2, width_ratios=[1.14, 1]))
    figure = new_figure(5.6)
    panels: dict[str, Axes] = figure.subplot_mosaic([["whole", "close"], ["whole", "hole"]], width_ratios=[1.45, 1])
    return figure, [panels[name] for name in ("whole", "close", "hole")]


def _draw_hole(
    axes: Axes, nodes: NDArray[np.complex128], triangles: NDArray[np.intp], hole_points: NDArray[np.complex128]
) -> None:
    """The triangles about the first hole's patch."""
    points = hole_points[0]
    centre, reach = points.mean(), HOLE_PATCHES_SHOWN * float(np.ptp(np.abs(points - points[0])))
    corners = nodes[triangles[:, :3]] - centre
    visible = np.min(np.maximum(np.abs(corners.real), np.abs(corners.imag)), axis=1) < reach
    axes.triplot(Triangulation(nodes.real, nodes.imag, triangles[visible, :3]), color="0.7", linewidth=0.5)
    axes.plot(points.real, points.imag, color=ALARM, linewidth=4.0, solid_capstyle="butt")
    axes.set(xlim=(centre.real - reach, centre.real + reach), ylim=(centre.imag - reach, centre.imag + reach))
    axes.set_title("Hole 0")


def _loaded_patch(nodes: NDArray[np.complex128], centres: NDArray[np.complex128], size: NDArray[np.float64]) -> int:
    """The patch that deflects most: that of the loaded pin."""
    nearest_nodes = [int(np.argmin(np.abs(nodes - centre))) for centre in centres]
    return int(np.argmax(size[nearest_nodes]))


def _draw_flank(
    axes: Axes, plane: Triangulation, patch_points: NDArray[np.complex128], loaded_patch: int, reach: float
) -> None:
    """The triangles and patches within ``reach`` [mm] of the loaded patch."""
    centre = patch_points[loaded_patch].mean()
    corners = plane.x[plane.triangles] + 1j * plane.y[plane.triangles] - centre
    visible = np.min(np.maximum(np.abs(corners.real), np.abs(corners.imag)), axis=1) < reach
    axes.triplot(Triangulation(plane.x, plane.y, plane.triangles[visible]), color="0.7", linewidth=0.5)
    patches_shown = np.flatnonzero(np.min(np.abs(patch_points - centre), axis=1) < 2 * reach)
    neighbours = patches_shown[patches_shown != loaded_patch]
    for numbers, colour, label in (
        (neighbours, ACCENT, "contact patches"),
        ([loaded_patch], ALARM, "of the loaded pin"),
    ):
        points = patch_points[numbers].T
        lines = axes.plot(points.real, points.imag, color=colour, linewidth=4.0, solid_capstyle="butt")
        lines[0].set_label(label)
    # the corner that points away from the disk is empty
    legend_corner = f"{'upper' if centre.imag > 0 else 'lower'} {'right' if centre.real > 0 else 'left'}"
    axes.legend(loc=legend_corner, frameon=True, framealpha=1.0, edgecolor="none")
    axes.set(xlim=(centre.real - reach, centre.real + reach), ylim=(centre.imag - reach, centre.imag + reach))

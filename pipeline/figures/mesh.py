"""The condensed disk: its mesh, the patches, and how one pin's force deflects it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from pipeline.figures.style import ACCENT, ALARM, MUTED, new_figure, styled

PATCHES_SHOWN = 1.5
"""Half width of the close-up in distances between neighbouring patches."""


@styled
def mesh_figure(
    nodes: NDArray[np.complex128],
    triangles: NDArray[np.intp],
    patch_points: NDArray[np.complex128],
    displacement: NDArray[np.complex128],
) -> Figure:
    """Whole disk with the size of its deflection, and a close-up of the flank about the loaded pin's patch.

    Parameters
    ----------
    nodes : (n_nodes,) [mm], x + iy
    triangles : (n_triangles, 6), corners first
    patch_points : (n_patches, n_points) [mm], where the pressure is applied
    displacement : (n_nodes,) [um/N], by 1 N on the pin of the longest arm
    """
    figure = new_figure(4.1)
    whole, close = figure.subplots(1, 2, width_ratios=[1.12, 1])
    plane = Triangulation(nodes.real, nodes.imag, triangles[:, :3])
    size = np.abs(displacement)
    shaded = whole.tripcolor(plane, size, shading="gouraud", cmap="viridis", rasterized=True)
    figure.colorbar(shaded, ax=whole, label="deflection by 1 N on one pin (µm/N)", shrink=0.85).outline.set_visible(False)
    centres = patch_points.mean(axis=1)
    loaded = _loaded_patch(nodes, centres, size)
    apart = np.abs(centres - centres[loaded])
    reach = PATCHES_SHOWN * np.min(apart[apart > 0])
    _draw_flank(close, plane, patch_points, loaded, centres[loaded], reach)
    corner = centres[loaded] - reach * (1 + 1j)
    whole.add_patch(_frame(corner, 2 * reach))
    whole.set_title(f"{len(triangles):,} quadratic triangles, {len(nodes):,} nodes")
    close.set_title("Flank at the loaded pin, with contact patches")
    for axes in (whole, close):
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.grid(False)
    return figure


def _loaded_patch(nodes: NDArray, centres: NDArray, size: NDArray) -> int:
    """The patch that deflects most: that of the loaded pin."""
    nearest = np.array([np.argmin(np.abs(nodes - centre)) for centre in centres])
    return int(np.argmax(size[nearest]))


def _draw_flank(
    axes: Axes, plane: Triangulation, patch_points: NDArray, loaded: int, centre: complex, reach: float
) -> None:
    """The triangles in sight, and the patches on them."""
    x, y = plane.x[plane.triangles] - centre.real, plane.y[plane.triangles] - centre.imag
    seen = np.any(np.maximum(np.abs(x), np.abs(y)) < 1.3 * reach, axis=1)
    axes.triplot(Triangulation(plane.x, plane.y, plane.triangles[seen]), color="0.72", linewidth=0.4)
    for number, points in enumerate(patch_points):
        if np.min(np.abs(points - centre)) < 1.5 * reach:
            colour, width = (ALARM, 4.0) if number == loaded else (ACCENT, 3.0)
            axes.plot(points.real, points.imag, color=colour, linewidth=width, solid_capstyle="butt")
            axes.plot(*_ends(points), "|", color=colour, markersize=0)
    axes.plot([], [], color=ALARM, linewidth=4.0, label="loaded patch")
    axes.plot([], [], color=ACCENT, linewidth=3.0, label="other patches")
    axes.legend(loc="lower right", frameon=True, framealpha=1.0, edgecolor="none")
    axes.set(xlim=(centre.real - reach, centre.real + reach), ylim=(centre.imag - reach, centre.imag + reach))


def _ends(points: NDArray) -> tuple[NDArray, NDArray]:
    return points.real[[0, -1]], points.imag[[0, -1]]


def _frame(corner: complex, side: float):
    """Outline of the close-up."""
    from matplotlib.patches import Rectangle

    return Rectangle((corner.real, corner.imag), side, side, fill=False, edgecolor=MUTED, linewidth=0.8)

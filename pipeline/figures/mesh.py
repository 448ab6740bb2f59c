"""The condensed disk: its mesh, the patches, and how one pin's force deflects it."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from pipeline.figures.style import new_figure


def mesh_figure(nodes: np.ndarray, triangles: np.ndarray, patch_points: np.ndarray, displacement: np.ndarray) -> Figure:
    """Whole mesh with the size of the deflection, and a close-up of the flank with its patches.

    Parameters
    ----------
    nodes : (n_nodes,) complex [mm]
    triangles : (n_triangles, 6), corners first
    patch_points : (n_patches, n_points) complex [mm], where the pressure is applied
    displacement : (n_nodes,) complex [um/N], by 1 N on the pin of the longest arm
    """
    figure = new_figure(9.0, 4.4)
    whole, close = figure.subplots(1, 2)
    corners = triangles[:, :3]
    plane = Triangulation(nodes.real, nodes.imag, corners)
    shaded = whole.tripcolor(plane, np.abs(displacement), shading="gouraud", cmap="viridis", rasterized=True)
    figure.colorbar(shaded, ax=whole, label="deflection by 1 N on one pin / (um/N)", shrink=0.8)
    whole.set(title=f"{len(triangles):,} quadratic triangles, {len(nodes):,} nodes", aspect="equal")
    # the loaded pin's lobe
    target = nodes[np.argmax(np.abs(displacement))]
    close.triplot(plane, color="0.75", linewidth=0.3, rasterized=True)
    for points in patch_points:
        close.plot(points.real, points.imag, color="tab:red", linewidth=2.0)
    reach = 1.5 * np.median(np.abs(np.diff(patch_points.mean(axis=1))[: len(patch_points) // 2]))
    close.set(
        title="flank with contact patches",
        aspect="equal",
        xlim=(target.real - reach, target.real + reach),
        ylim=(target.imag - reach, target.imag + reach),
    )
    for axes in (whole, close):
        axes.set(xlabel="x / mm", ylabel="y / mm")
    return figure

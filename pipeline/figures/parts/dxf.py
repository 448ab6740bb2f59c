"""DXF files of closed outlines, for CAD and measuring machines."""

import io
from collections.abc import Mapping

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

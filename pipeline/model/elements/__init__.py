"""What a drive has beside its reducer: elements, each at one place, with a memory of its own where it has one."""

from pipeline.model.elements.element import AngleError, Element, Hysteresis, Path, Spring, merged_path, polyline, same
from pipeline.model.elements.friction import Friction
from pipeline.model.elements.modulus import ElasticModulus

__all__ = [
    "AngleError",
    "ElasticModulus",
    "Element",
    "Friction",
    "Hysteresis",
    "Path",
    "Spring",
    "merged_path",
    "polyline",
    "same",
]

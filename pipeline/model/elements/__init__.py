"""What a drive has beside its reducer: elements, each at one place, with a memory of its own where it has one."""

from pipeline.model.elements.element import Element, Hysteresis, Path, Spring, merged_path, polyline, same
from pipeline.model.elements.friction import Friction
from pipeline.model.elements.modulus import ElasticModulus

__all__ = [
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

"""What a drive has beside its reducer: elements, each at one place, with a memory of its own where it has one."""

from pipeline.model.elements.element import Element, Hysteresis, Path, Spring, merged_path, polyline, same
from pipeline.model.elements.friction import Friction
from pipeline.model.elements.modulus import ElasticModulus
from pipeline.model.elements.rounded_play import RoundedPlay
from pipeline.model.elements.sliding_friction import FirstLoading, SlidingFriction

__all__ = [
    "ElasticModulus",
    "Element",
    "FirstLoading",
    "Friction",
    "Hysteresis",
    "Path",
    "RoundedPlay",
    "SlidingFriction",
    "Spring",
    "merged_path",
    "polyline",
    "same",
]

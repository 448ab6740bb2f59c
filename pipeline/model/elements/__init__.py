"""What a drive has beside its reducer: elements, each at one place, with a memory of its own where it has one."""

from pipeline.model.elements.element import (
    ElasticModulus,
    Element,
    Hysteresis,
    Path,
    RoundedPlay,
    Spring,
    merged_path,
    same,
)
from pipeline.model.elements.sliding_friction import FirstLoading, Friction, SlidingFriction

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
    "same",
]

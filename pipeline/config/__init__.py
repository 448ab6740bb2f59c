"""Design and study files: what they may contain, and reading them with every problem named at once."""

from pipeline.config.designs.design import Design
from pipeline.config.reading import load_design, load_study, load_unit, parse_design, parse_study
from pipeline.config.studies.study import Study

__all__ = ["Design", "Study", "load_design", "load_study", "load_unit", "parse_design", "parse_study"]

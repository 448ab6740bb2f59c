"""The sections of a study's report, one file each, in rooms by what they tell of.

A file defines ``SECTION``; adding one is adding a file: its heading, its entry in the contents, its figures and their
numbers follow from it. A long template lies beside it.
"""

from pipeline.report.sections.section import Page, Section, drawings, library, sections_of

__all__ = ["Page", "Section", "drawings", "library", "sections_of"]

"""The sections of a study's report, by their subject.

A file defines one ``SECTION`` or a table ``SECTIONS``; its heading, its entry in the contents, its figures and their
numbers follow from it. A long template lies beside it.
"""

from pipeline.report.sections.section import Page, Section, drawings, library, sections_of

__all__ = ["Page", "Section", "drawings", "library", "sections_of"]

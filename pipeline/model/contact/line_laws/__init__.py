"""The laws of the line contacts that a study can choose, one file each.

A file defines ``LAW``; adding one is adding a file: a study may name it, and the report tells its title and source.
"""

from pipeline.model.contact.line_laws.contact_law import ContactLaw, library

__all__ = ["ContactLaw", "library"]

"""The output mechanisms that a design can choose, one file each.

A file defines ``MECHANISM``; adding one is adding a file: its settings in a design with what they may be, its bodies
and contacts, their laws, the holes that it cuts into the disk, its drawing and its words in the report follow from it.
"""

from pipeline.config.mechanisms.mechanism import OutputMechanism, library

__all__ = ["OutputMechanism", "library"]

"""Kinds of constants that steer no verdict, named where one is declared; ``docs/constants.py`` counts the others."""

Unit = float
"""A conversion between units, or of one measure of the same thing into another."""
Rounding = float
"""What counts as equal, or as zero, in floating point; and steps of derivatives."""
Fineness = int
"""Nodes, draws, rounds and values that are kept: as many as let what they approximate be far from any limit."""
Seed = int
"""Of random draws: equal data give an equal page."""
Grid = tuple[float, ...]
"""Values of a continuous number that are looked at, as near to each other as ``Fineness`` means."""
Shortcut = float
"""Of a search and its iterations: how long they take, not what they find; ``tests/attack/test_shortcuts.py`` has each
of them switched off."""
ShortcutCount = int
"""The same of whole numbers."""
ShortcutGrid = tuple[float, ...]
"""The same of several values."""
ShownRange = tuple[float, float]
"""Ends of what a page or a message calls likely."""
Shown = float
"""What a page or a message says beside a verdict that is reached without it."""
ShownCount = int
"""The same of whole numbers."""

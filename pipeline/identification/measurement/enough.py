"""How much data a statement takes: numbers that all of the identification shares."""

FEWEST_COMPARED = 3
"""Values whose scatter about a mean or a line is known: rows of a cell, cells of a branch, turns, levels, positions,
cycles or states. Of two, one that is held against the other leaves no scatter."""
FEWEST_SCATTERED = FEWEST_COMPARED**2
"""Rows of a branch from which its curve and its scatter are told apart."""
FEWEST_PIECE_ROWS = 5
"""Rows in turn from which a piece of a record has a shape: a branch, a flat tail, an extreme that repeats."""
FEWEST_OF_A_WAVE = 4
"""Values over a wave from which it can be tested: one more than its mean, amplitude and phase."""
SINGLE_GROUPS = 6
"""Positions (or cycles) up to which each is left out by itself; more are left out in three lots, spread evenly over
them, so that the time grows as the rows do. Of effects of the crank angle there are as many lots as this."""
LEAST_PART = 0.5
"""Share of the longest loop, turn or pass that one must have to count: pieces at the ends are left out."""
LOADED_SHARE = 0.5
"""Share of the largest torque from which a drive is loaded, and its loop shows the spring: the upper half."""
UNLOADED_SHARE = 0.2
"""Share of the largest torque below which a drive is hardly loaded: play decides its curve, and, until the load first
exceeds it, where friction had held the drive before the record began."""
BENT = 2.0
"""Ratio of the slopes of two parts of a curve by which it is bent: play makes it soft near no torque."""
SURE = 4.0
"""Standard deviations of noise that a sum or a reading is beyond zero by: noise alone is, once in 30,000."""

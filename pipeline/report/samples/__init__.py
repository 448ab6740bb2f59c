"""How many samples a study has and what more of them would tell: a section of the page, and of the summary."""

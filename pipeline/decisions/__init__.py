"""What a maker decides by: two runs side by side, what tolerances cost, worst cases, and how many samples it takes."""

"""Several states of one drive fitted together: what belongs to its parts is shared, the rest is each state's own."""

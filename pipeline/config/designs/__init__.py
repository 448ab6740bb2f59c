"""Design files: what a reducer is made of."""

"""What is said of a unit once models are selected: the verdict, what is left, what could hide."""

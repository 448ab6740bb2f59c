"""Worst cases over the tolerance box, beside statistics: bounds, linear stacks, and capability."""

"""Pages on decisions: the cheapest tolerances, worst cases, two runs beside each other."""

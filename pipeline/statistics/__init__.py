"""What samples tell about a metric, with intervals: its distribution, its yield, and which error drives it."""

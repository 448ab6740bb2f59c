"""What came out: the question, the metrics with their yield, the tails, and which tolerance decides."""

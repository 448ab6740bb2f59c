"""Units that a reader questions in the page."""

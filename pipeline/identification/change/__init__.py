"""Two measurements of one drive against each other: what has changed between them."""

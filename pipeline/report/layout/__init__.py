"""What every page looks like: its frame, its style, and how templates become pages."""

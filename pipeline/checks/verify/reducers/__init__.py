"""Checks of whole reducers of other kinds than the paper's, each by a study of its own."""

"""TOML and CSV files: sections, problems told by key, and what is written."""

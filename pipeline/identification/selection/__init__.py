"""Which effects are supported: screening, held-out errors, selection, verdict."""

"""Play of the rigid reducer: from the gaps of its contacts to the turn it is free to make."""

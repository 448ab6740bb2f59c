"""What a reader looks up: definitions, limits of the model, numbers of the design, tables and versions."""

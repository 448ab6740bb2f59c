"""What the package does, as functions on objects: the command line prints what they return."""

"""What resists the motion."""

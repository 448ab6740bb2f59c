"""Drives of which no design is known: play, friction and a spring."""

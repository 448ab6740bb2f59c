"""A drive without a design: the description by play, friction and a spring that its data support."""

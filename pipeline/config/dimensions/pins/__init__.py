"""Dimensions of the pins and of the ring that holds them."""

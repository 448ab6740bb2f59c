"""Dimensions of the disks: flank, bore and holes."""

"""Meshed disk, pressure patches, and the disk condensed to a compliance between its contacts."""

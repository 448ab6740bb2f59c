"""Dimensions, wear and temperature: what opens or closes gaps."""

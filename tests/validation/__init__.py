"""What judges the product and is not part of it: speed, blind units, a rig's data, coverage of intervals, licences."""

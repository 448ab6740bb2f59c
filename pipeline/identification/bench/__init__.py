"""What the bench reads: effects of the instrument, and the response of a drive to a load program."""

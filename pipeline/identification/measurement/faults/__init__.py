"""What is wrong with the data of a measured unit, each kind told once."""

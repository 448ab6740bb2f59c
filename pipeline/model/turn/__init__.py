"""A turn of the crank: forces under a torque that is held, sliding, life, and the orders of an error."""

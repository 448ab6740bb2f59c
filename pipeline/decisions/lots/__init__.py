"""Measured parts of a lot: fitted distributions, capability, and the yield of a study that is made from them."""

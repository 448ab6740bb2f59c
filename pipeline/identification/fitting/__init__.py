"""Parameters, prior and data of a fit, and its descent."""

"""The one nonlinear solve: contact forces and rigid motions under output torques."""

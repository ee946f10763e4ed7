"""Differentiable simulation of electrohydraulic servovalves and actuators in JAX."""

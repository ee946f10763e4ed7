"""An independent NumPy simulator of the servovalve's static tests.

It shares no line with thermohyd and uses no JAX: where the two agree, two separate readings of the same equations do.
The physics is written in its textbook form (flow coefficient, orifice and land in series), solved to rounding error.
"""

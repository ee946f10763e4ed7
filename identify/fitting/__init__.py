"""Which parameters explain the readings, by least squares, and how well they are known."""

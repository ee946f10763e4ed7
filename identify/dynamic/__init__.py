"""Dynamic bench tests: the actuator simulated at a record's rows, its parameters fitted, its predictions."""

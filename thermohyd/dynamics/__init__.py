"""The actuator in time (docs/physics.md section 9): `simulate` runs a record's rows, `small_signal` linearises the same equations."""

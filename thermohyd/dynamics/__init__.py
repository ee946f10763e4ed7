"""The actuator in time (MODEL section 7): `simulate` runs a record's rows, `small_signal` linearises the same equations."""

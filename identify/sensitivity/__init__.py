"""Which parameter matters: local and global sensitivities, temperature drift, information of measurements, next test."""

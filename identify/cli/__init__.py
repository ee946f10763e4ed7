"""The commands of `thermohyd`: read, compute, show."""

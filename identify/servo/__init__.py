"""`thermohyd servo`: what temperature does to the position loop, in step responses and margins."""

"""A robot's side of API, bus and lease, outages included."""

"""The HTTP side of the farm, under /v1."""

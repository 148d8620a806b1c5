"""Webhooks: the farm calls users' addresses when their jobs end, but never an address of its own network."""

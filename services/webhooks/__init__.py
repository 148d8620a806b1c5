"""Webhooks: addresses of users that the farm calls when their jobs end, and never an address of its own network."""

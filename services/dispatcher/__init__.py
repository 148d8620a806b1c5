"""Gives leases: presence from the bus, choice from the database, offers over the bus."""

"""The farm's robots: each a process that takes leases, runs trials and uploads what happened."""

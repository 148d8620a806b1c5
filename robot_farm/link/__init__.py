"""What a robot says to the farm: API, bus, lease, and what it does in an outage."""

"""What tosses of an object say about friction, contacts, size, gravity and the measurement's scale."""

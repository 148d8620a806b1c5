"""Who may come onto the bus and what he may say there: the farm's own certificates and its access rules."""

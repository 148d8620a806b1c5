"""Admission to the bus and what each may say on it: the farm's certificates and access rules."""

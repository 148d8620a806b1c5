"""A whole farm on this machine: its options, its folder, its processes."""

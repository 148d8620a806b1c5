"""Jobs, trials, leases and reports, with every transition of their states."""

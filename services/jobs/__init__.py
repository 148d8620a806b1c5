"""Jobs, trials, leases and reports: every move of their states is in this package."""

"""What commands share at the terminal: options, output, errors, exit codes, child programs."""

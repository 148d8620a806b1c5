"""What people see of a job: progress while it runs, figures and print afterwards."""

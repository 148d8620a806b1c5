"""What happens to a policy at the door: checked, converted in a child process, run on recorded observations, kept."""

"""What an extended model bought in success: rates of a policy predicted by both models and measured."""

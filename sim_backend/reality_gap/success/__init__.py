"""The extended model's gain in success: a policy's rates predicted by both models, compared with measured ones."""

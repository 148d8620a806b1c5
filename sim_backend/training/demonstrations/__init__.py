"""Learning from what others did: recording, cloning, DAgger, a demonstration term for PPO, and residuals."""

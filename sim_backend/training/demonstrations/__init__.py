"""Learning from demonstrations: recording, cloning, DAgger, a demonstration term for PPO, and residuals."""

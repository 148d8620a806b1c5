"""Registers the environments with Gymnasium: ``gymnasium.make("trifarm.environments:trifarm/Push-v0")``."""

from sim_backend.environments.gym_env import IDS, TrifingerEnv

__all__ = ["IDS", "TrifingerEnv"]

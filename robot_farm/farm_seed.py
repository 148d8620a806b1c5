"""The seed of a farm as its robots are told: in the environment, which nobody else can read, unlike a command line."""

import os

FARM_SEED_VARIABLE = "TRIFARM_FARM_SEED"


def given_seed() -> int | None:
    """The seed in the environment, None if there is none.

    Raises:
        ValueError: it is no whole number of 0 or more.
    """
    text = os.environ.get(FARM_SEED_VARIABLE, "")
    if not text:
        return None
    if not (text.isascii() and text.isdigit()):
        raise ValueError(f"{FARM_SEED_VARIABLE} is {text!r}; it must be a whole number of 0 or more")
    return int(text)

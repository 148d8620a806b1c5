"""What makes a robot different from every other, drawn from the farm's secret. Only the robot itself may look.

``python -m robot_farm.hidden_physics --data DIR --robot NAME --physics NAME`` prints it, for operators on the farm's machine.
"""

import argparse
import hashlib
import hmac
import json
import os
import secrets
import sys
from pathlib import Path

import numpy as np

from robot_farm.prepared import TrialPhysics
from robot_farm.settings import given_seed
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.refusal import refused

SECRET_FILE = "farm-secret"  # noqa: S105 - the name of a file, not a secret
SECRET_BYTES = 32
ROBOTS = "robots"


class HiddenPhysics:
    """The physics of one robot and of its trials, reproducible from the farm's secret.

    Args:
        secret: of the farm.
        robot: name of the robot.
        physics: name of a table of ranges, or path of a file with one or with the effects that all robots shall have.

    Raises:
        ValueError: there is no such table, or it is wrong; the message says what.
    """

    def __init__(self, secret: bytes, robot: str, physics: str) -> None:
        self._secret, self._robot = secret, robot
        self._ranges = load_ranges(physics)
        self.physics: Physics = self._ranges.draw(self.generator("physics"), 1)

    def generator(self, purpose: str) -> np.random.Generator:
        """Random numbers for one purpose of this robot, the same whenever it is asked."""
        return np.random.default_rng(int.from_bytes(self._digest(purpose)))

    def of_trial(self, seed: int | str, attempt: int) -> TrialPhysics:
        """The physics of one attempt at a trial: the robot's, what differs from trial to trial, and a seed of its noise.

        Nobody can foresee it who does not know the secret. Whoever asks for the same seed again gets the same and no other
        draw, so that policies can be compared in pairs and a farm of the same seed comes again. A self-test has a name for
        a seed.
        """
        rng = self.generator(f"trial:{seed}:{attempt}")
        noise_seed = int(rng.integers(0, 2**53))
        return TrialPhysics(self._ranges.draw_episode(rng, self.physics), noise_seed, rng)

    def digest(self) -> str:
        """32 hexadecimal digits that all robots of this secret and this content of the physics share, and no others.

        It is of what a robot with a name that none can have would be, in itself and in one trial, so that a changed range, file
        or way to draw shows. Whoever has it can try small farm seeds; it is for the services alone.
        """
        rng = np.random.default_rng(int.from_bytes(hmac.digest(self._secret, b":content", "sha256")))
        drawn = self._ranges.draw(rng, 1)
        content = [drawn.document(), self._ranges.draw_episode(rng, drawn).document()]
        return hmac.digest(self._secret, json.dumps(content, sort_keys=True).encode(), "sha256").hex()[:32]

    def _digest(self, purpose: str) -> bytes:
        return hmac.digest(self._secret, f"{self._robot}:{purpose}".encode(), "sha256")


def farm_secret(folder: Path, farm_seed: int | None) -> bytes:
    """The secret of a farm: from its seed if it has one, otherwise drawn once and kept in ``folder``.

    Several robots may ask at the same time; all get the same.

    Raises:
        ValueError: the file that is kept is no secret of a farm.
    """
    if farm_seed is not None:
        return hashlib.sha256(f"trifarm farm seed {farm_seed}".encode()).digest()
    path = folder / SECRET_FILE
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        own = folder / f".{SECRET_FILE}-{os.getpid()}-{secrets.token_hex(4)}"
        with os.fdopen(os.open(own, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(secrets.token_bytes(SECRET_BYTES))
            file.flush()
            os.fsync(file.fileno())  # or a crash of the machine might leave the name without the bytes
        try:
            os.link(own, path)  # whole or not at all, and only for the first
        except FileExistsError:
            pass
        finally:
            own.unlink()
    secret = path.read_bytes()
    if len(secret) != SECRET_BYTES:
        raise ValueError(
            f"{path} has {len(secret)} bytes instead of {SECRET_BYTES}: restore it from a copy, or remove it to have another "
            "secret drawn, which makes other robots of all"
        )
    return secret


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="python -m robot_farm.hidden_physics", description="Print a robot's hidden physics.")
    parser.add_argument("--data", type=Path, required=True, help="the farm's data folder")
    parser.add_argument("--robot", required=True, help="name of the robot, such as robot-0")
    parser.add_argument(
        "--physics", default="real", help="what the farm was started with: nominal, mild, real, real-images, real-2 or a file"
    )
    parser.add_argument("--farm-seed", type=int, help="what the farm was started with, if it was given a seed")
    parser.add_argument("--json", action="store_true", help="print one line of JSON")
    options = parser.parse_args(arguments)
    try:
        farm_seed = options.farm_seed if options.farm_seed is not None else given_seed()
        _check_robot(options.data / ROBOTS, options.robot, farm_seed)
        hidden = HiddenPhysics(farm_secret(options.data / ROBOTS, farm_seed), options.robot, options.physics)
    except (ValueError, OSError) as error:
        return refused(str(error), options.json)
    document = {"robot": options.robot, "physics": options.physics, "effects": hidden.physics.document()}
    print(json.dumps(document, indent=None if options.json else 2))
    return 0


def _check_robot(folder: Path, robot: str, farm_seed: int | None) -> None:
    """A name is enough to draw physics: raise ValueError if no such robot has run on this folder, which each has its own in."""
    if farm_seed is None and not (folder / SECRET_FILE).exists():
        raise ValueError(f"{folder} has no {SECRET_FILE}: no robot with hidden physics has run there yet")
    there = sorted((each.name for each in folder.glob("*") if each.is_dir()), key=lambda name: (len(name), name))
    if robot not in there:
        raise ValueError(
            f"no robot {robot!r} has run on {folder}; choose from {', '.join(there) or 'none: start the farm first'}"
        )


if __name__ == "__main__":
    sys.exit(main())

"""The robot's side of what a policy sees: memory that the robot writes and the policy's process can only read."""

import fcntl
import os

import numpy as np

from api_schemas.policy_images import PolicyImages


class ShownImages:
    """Images of one policy process. Owner of their memory, whose size nobody can change any more.

    Attributes:
        reading_fd: for the process; nothing can be written through it.
        arguments: of the process: that descriptor and the images' shape.
    """

    def __init__(self, images: PolicyImages) -> None:
        self._shape = images.shape
        self._shown: np.ndarray | None = None
        self._fd = os.memfd_create("images", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(self._fd, images.size)
        fcntl.fcntl(self._fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
        self.reading_fd = os.open(f"/proc/self/fd/{self._fd}", os.O_RDONLY | os.O_CLOEXEC)
        self.arguments = [str(self.reading_fd), *map(str, self._shape)]

    def show(self, images: np.ndarray) -> None:
        """Write images of the manifest's shape, uint8; those that are there already cost nothing."""
        if images is self._shown:
            return
        assert images.shape == self._shape and images.dtype == np.uint8, "the farm makes what the manifest asks for"
        os.pwrite(self._fd, images.tobytes(), 0)
        self._shown = images

    def close(self) -> None:
        """Give the memory back once the process has ended."""
        for fd in (self._fd, self.reading_fd):
            try:
                os.close(fd)
            except OSError:
                continue  # closed before

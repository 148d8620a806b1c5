"""What is written when: what a power cut would leave cannot be tried, the order of the steps can."""

import os
from pathlib import Path


def noted_steps(monkeypatch) -> list[tuple[str, str]]:
    """From here on which files and folders are synced, and which names are given, by rename or link, in their order."""
    steps, sync, replace, link = [], os.fsync, Path.replace, os.link

    def noted_sync(descriptor):
        steps.append(("synced", Path(os.readlink(f"/proc/self/fd/{descriptor}")).name))  # noqa: PTH115  of a descriptor
        sync(descriptor)

    def noted_replace(fresh, path):
        steps.append(("named", Path(path).name))
        return replace(fresh, path)

    def noted_link(fresh, path):
        steps.append(("named", Path(path).name))
        link(fresh, path)

    monkeypatch.setattr(os, "fsync", noted_sync)
    monkeypatch.setattr(Path, "replace", noted_replace)
    monkeypatch.setattr(os, "link", noted_link)
    return steps


def in_place(fresh: str, path: Path) -> list[tuple[str, str]]:
    """The steps by which a file comes into its place so that a power cut leaves it whole, or what was there before."""
    return [("synced", fresh), ("named", path.name), ("synced", path.parent.name)]

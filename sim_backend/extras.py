"""What to type where packages of an extra are missing."""


def how_to_install(*extras: str) -> str:
    """The command that brings them: of the clone or a wheel, since no registry has this project."""
    named = f"[{','.join(extras)}]"
    return f"pip install -e '.{named}' in the clone, or the wheel with '{named}' after its name"

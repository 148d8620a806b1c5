"""What every command prints on stdout with ``--json`` when it failed after its arguments were understood."""


def error_document(title: str, detail: str, exit_code: int, **more: object) -> dict[str, object]:
    """The one JSON document of a command that failed.

    Args:
        title: the kind of error in a few words.
        detail: one sentence that names the value and what to do.
        exit_code: of the process.
        more: further members, as ``type`` and ``status`` of a server's problem.
    """
    return {"error": {"title": title, "detail": detail, "exit_code": exit_code, **more}}

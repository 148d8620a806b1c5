"""The errors of the services; each carries the HTTP status and the problem type it is shown with.

ServiceError
  +- NotFound             404  what was named does not exist, or is another owner's
  +- Conflict             409  the state does not allow it (also stale fences and idempotency keys)
  +- Refused              422  the content cannot be accepted
  +- TooSlow              408
  +- TooLarge             413
  +- Unauthorised         401
  +- Forbidden            403  a scope is missing, or a share is used up
  +- TooMany              429  more at once than one may ask for
  +- Unavailable          503  a part of the farm is away; try again
"""

from typing import Any


class ServiceError(Exception):
    """An expected error; ``detail`` names the value, the limit and the next step."""

    status = 400
    title = "Request refused"

    def __init__(self, slug: str, detail: str, **members: Any) -> None:
        super().__init__(detail)
        self.slug = slug
        self.detail = detail
        self.members = members


class NotReady(Exception):
    """The services cannot start; the message says what they found and what to do next."""


class NotFound(ServiceError):
    """What was named does not exist for this caller."""

    status = 404
    title = "Not found"


class Conflict(ServiceError):
    """The present state does not allow the request."""

    status = 409
    title = "Conflict with the present state"


class Refused(ServiceError):
    """The content of the request cannot be accepted."""

    status = 422
    title = "Content refused"


class TooSlow(ServiceError):
    """The body did not come in time."""

    status = 408
    title = "Too slow"


class TooLarge(ServiceError):
    """More bytes than the farm takes."""

    status = 413
    title = "Too large"


class Unauthorised(ServiceError):
    """No token, or one that is not valid."""

    status = 401
    title = "Token needed"


class Forbidden(ServiceError):
    """A valid token that may not do this."""

    status = 403
    title = "Not allowed"


class TooMany(ServiceError):
    """More at once than one may ask for; ``retry_after_s`` is when to ask again at the earliest."""

    status = 429
    title = "Too many"

    def __init__(self, slug: str, detail: str, retry_after_s: int, **members: Any) -> None:
        super().__init__(slug, detail, **members)
        self.retry_after_s = retry_after_s


DISK_FULL = "The disk of the farm is full; nothing was kept of this request. Try again once its operator has made room."


class Unavailable(ServiceError):
    """A part of the farm is away for now."""

    status = 503
    title = "Not available now"

"""What requests depend on is asked for on the event loop: a function that is not asynchronous costs each a way to a thread."""

import importlib
import inspect
import pkgutil

from fastapi import APIRouter
from fastapi.routing import APIRoute

from services import api, dashboard


def routes():
    for package in (api, dashboard):
        for found in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
            module = importlib.import_module(found.name)
            for value in vars(module).values():
                if isinstance(value, APIRouter):
                    yield from (route for route in value.routes if isinstance(route, APIRoute))


def calls(dependant):
    """The route's own function and all that it depends on."""
    yield dependant.call
    for each in dependant.dependencies:
        yield from calls(each)


def is_asynchronous(call):
    """Functions, generators, and objects that are called, such as FastAPI's own for a header."""
    function = call if inspect.isroutine(call) else type(call).__call__
    return inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function)


def test_every_route_and_all_that_it_depends_on_is_asynchronous():
    found = {call for route in routes() for call in calls(route.dependant)}
    assert len(found) > 60
    assert [str(call) for call in found if not is_asynchronous(call)] == []

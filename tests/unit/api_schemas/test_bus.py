"""A session of the bus is back soon after its router is."""

import subprocess
import sys
import time

import zenoh

from api_schemas import bus
from tests.integration.farm_process import PATIENCE_S, ROOT, free_port
from tests.stalls import stalls

ROUTER = """
import sys, time, zenoh
from api_schemas import bus
with zenoh.open(zenoh.Config.from_json5(bus.session_config_json(mode="router", listen=[sys.argv[1]]))) as session:
    answering = session.declare_queryable("there", lambda query: query.reply("there", b"yes"))
    print("up", flush=True)
    time.sleep(600)
"""
AWAY_S = 4.0
"""A session that looks for its router after 1, 3 and 7 s would be back 3 s after it."""


def router(endpoint):
    running = subprocess.Popen([sys.executable, "-c", ROUTER, endpoint], cwd=ROOT, stdout=subprocess.PIPE)
    assert running.stdout.readline() == b"up\n"
    return running


def test_a_session_is_back_soon_after_its_router():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    first = router(endpoint)
    with zenoh.open(zenoh.Config.from_json5(bus.session_config_json(mode="client", connect=[endpoint]))) as session:
        assert list(session.get("there", timeout=PATIENCE_S))
        first.kill()
        first.communicate()
        time.sleep(AWAY_S)
        second = router(endpoint)
        up_s = time.monotonic()
        with stalls() as stalled:
            while not list(session.get("there", timeout=0.5)) and time.monotonic() - up_s < PATIENCE_S:
                time.sleep(0.05)
        back_s = time.monotonic() - up_s
    second.kill()
    second.communicate()
    assert back_s < 2.0 + stalled.seconds


def test_a_router_takes_more_than_the_thousand_sessions_that_are_usual():
    config = zenoh.Config.from_json5(bus.session_config_json(mode="router", listen=["tcp/127.0.0.1:0"]))
    assert int(config.get_json("transport/unicast/max_sessions")) == bus.MAX_SESSIONS > 10_000

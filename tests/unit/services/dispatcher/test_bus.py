"""What robots say is heard by who listens, over a real session, and no longer by who has stopped."""

import asyncio
import json

import zenoh

from api_schemas import bus as keys
from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from services.dispatcher.bus import Bus
from tests.integration.farm_process import PATIENCE_S, free_port


def config(**more):
    listens = {"scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}}, "mode": "peer"}
    return json.dumps(listens | more)


async def until(happened):
    async with asyncio.timeout(PATIENCE_S):
        while not happened():  # noqa: ASYNC110  zenoh's threads tell it
            await asyncio.sleep(0.02)


async def test_who_stands_by_hears_nothing_until_it_listens_again():
    address, heard, came = f"tcp/127.0.0.1:{free_port()}", [], []
    bus = await Bus.open(config(listen={"endpoints": [address]}), "farm")
    robot = zenoh.open(zenoh.Config.from_json5(config(connect={"endpoints": [address]})))

    def listen():
        bus.on_heartbeat(lambda beat: heard.append(beat.instance))
        bus.on_presence(lambda name, present: came.append((name, present)))

    def says(instance):
        beat = Heartbeat(robot="robot-0", instance=instance, pid=1, host="h", state=RobotState.IDLE)
        robot.put(keys.heartbeat_key("farm", "robot-0"), beat.model_dump_json())

    try:
        token = robot.liveliness().declare_token(keys.alive_key("farm", "robot-0"))
        listen()
        await until(lambda: came == [("robot-0", True)])
        says("first")
        await until(lambda: heard == ["first"])
        bus.hear_no_more()
        says("unheard")
        await asyncio.sleep(0.3)
        assert (heard, came) == (["first"], [("robot-0", True)])
        listen()
        await until(lambda: came == [("robot-0", True), ("robot-0", True)])
        says("again")
        await until(lambda: heard == ["first", "again"])
        token.undeclare()
        await until(lambda: came[-1] == ("robot-0", False))
    finally:
        robot.close()
        await bus.close()

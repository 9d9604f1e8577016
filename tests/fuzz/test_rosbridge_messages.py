"""Messages to the rosbridge server with something wrong in them: it answers the next client as before.

The oracle: after all of them a client gets the answer of a service on the same connection, and another client
on its own.
"""

import json
import random
from concurrent.futures import ThreadPoolExecutor

import pytest
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

from pepper_kin.ros.transports.rosbridge import RosbridgeServer

LAST = json.dumps({"op": "call_service", "service": "/rosapi/get_time", "id": "last"})


@pytest.fixture(scope="module")
def server():
    with RosbridgeServer(port=0) as made:
        yield made


def malformed(random_numbers):
    """Return a message with something wrong in it."""
    operations = (
        "publish",
        "subscribe",
        "advertise",
        "call_service",
        "send_action_goal",
        "fragment",
        "status",
    )
    odd = (None, -1, 1e308, True, "", "/x", [], {}, [[]], {"a": {}}, "\ud800", "x" * 500)
    fields = (
        "topic",
        "type",
        "msg",
        "id",
        "service",
        "args",
        "action",
        "data",
        "num",
        "total",
        "level",
        "op",
    )
    text = json.dumps(
        {"op": random_numbers.choice(operations)}
        | {random_numbers.choice(fields): random_numbers.choice(odd) for _ in range(3)}
    )
    kind = random_numbers.randrange(4)
    if kind == 0:
        return text
    place = random_numbers.randrange(len(text))
    if kind == 1:
        return text[:place]
    if kind == 2:
        return text[:place] + random_numbers.choice('{}[]",:\\\0é') + text[place + 1 :]
    return random_numbers.randbytes(20)


def answered(server, texts):
    """Send texts; return whether the last, a call, was answered."""

    async def converse():
        socket = await websocket_connect(server.url)
        for text in [*texts, LAST]:
            await socket.write_message(text, binary=isinstance(text, bytes))
        found = False
        while not found and (answer := await socket.read_message()) is not None:
            found = json.loads(answer).get("id") == "last"
        socket.close()
        return found

    def converse_in_a_loop():
        loop = IOLoop(make_current=False)
        try:
            return loop.run_sync(converse, timeout=3600)
        finally:
            loop.close()

    # In a separate thread: where a browser is driven by the same process, this one has a running loop.
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(converse_in_a_loop).result()


def test_malformed_messages_do_not_end_the_server(server, amount, tried):
    """Malformed rosbridge messages: the server goes on, for this client and for others."""
    count, random_numbers = amount(300, 10_000, 1_000_000), random.Random(8)
    rounds = [min(2_000, count - k) for k in range(0, count, 2_000)]
    wrong = sum(not answered(server, [malformed(random_numbers) for _ in range(size)]) for size in rounds)
    wrong += not answered(server, [])
    tried("malformed rosbridge messages", count, wrong)

"""Clients of a suite that runs: a zenoh session, and the page of `modulo view` without a browser."""

import asyncio
import contextlib
import json

import websockets
import zenoh


def session(domain, *settings):
    """A session in the ROS domain `domain`, which meets the nodes as they meet each other; `settings` are of its configuration."""
    config = zenoh.Config()
    for key, value in [
        ("mode", '"peer"'),
        ("connect/endpoints", f'["tcp/127.0.0.1:{7450 + domain}"]'),
        ("listen/endpoints", '["tcp/127.0.0.1:0"]'),
        ("scouting/multicast/enabled", "false"),
        *settings,
    ]:
        config.insert_json5(key, value)
    return zenoh.open(config)


async def page(port, token, topics, seconds):
    """Watches `topics`, and draws each image at once."""
    async with websockets.connect(f"ws://127.0.0.1:{port}/socket?token={token}", max_size=None) as socket:
        await socket.send(json.dumps({"watch": topics}))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                while True:
                    if isinstance(await socket.recv(), bytes):
                        await socket.send(json.dumps({"drawn": topics}))

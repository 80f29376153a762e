"""A router of zenoh from PyPI (eclipse-zenoh), set up as the router of rmw_zenoh_cpp, until it is ended.

    [ZENOH_ROUTER_CONFIG_URI=FILE] [ZENOH_CONFIG_OVERRIDE="KEY=JSON5;..."] python tests/peers/router.py
"""

import os
import signal

import zenoh

SETTINGS = {
    "mode": '"router"',
    "listen/endpoints": '["tcp/[::]:7447"]',
    "connect/timeout_ms": "-1",
    "connect/exit_on_failure": "false",
    "scouting/multicast/enabled": "false",
    "scouting/gossip/target": '{ router: ["router", "peer"], peer: ["router"] }',
    "timestamping/enabled": "true",
}

file = os.environ.get("ZENOH_ROUTER_CONFIG_URI")
config = zenoh.Config.from_file(file) if file else zenoh.Config()
for key, value in {} if file else SETTINGS.items():
    config.insert_json5(key, value)
for setting in filter(None, os.environ.get("ZENOH_CONFIG_OVERRIDE", "").split(";")):
    config.insert_json5(*setting.split("=", 1))
# As that of rmw_zenoh_cpp. Network namespaces share the memory of one machine, so that images would not cross the link.
config.insert_json5("transport/shared_memory/enabled", "false")
with zenoh.open(config):
    signal.sigwait({signal.SIGINT, signal.SIGTERM})

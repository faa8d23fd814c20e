"""Zenoh sessions by the recipe that was measured for this use (docs/adr/0009 says why)."""

# pyright: reportUnknownMemberType=false
# (Zenoh's stubs leave return types out.)

import asyncio
import json
import time
from collections.abc import Sequence
from typing import Any

import structlog
import zenoh
from muster_schemas.channels import CHANNELS, Kind

from .wire import MAX_MESSAGE_BYTES, size_limit

_log = structlog.stdlib.get_logger(__name__)

LEASE_S = 2.0
"""A process that hangs or is cut off loses its tokens after this long (one that dies: within milliseconds)."""


def _settings(mode: str, settings: dict[str, Any]) -> dict[str, Any]:
    common: dict[str, Any] = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "queries_default_timeout": 2000,
    }
    transport: dict[str, Any] = {
        "link": {
            "tx": {
                "lease": int(LEASE_S * 1000),
                "keep_alive": 4,
                # A reader that takes nothing is cut off before a blocked writer's watchdog would end the writer.
                "queue": {"congestion_control": {"block": {"wait_before_close": 1_000_000}}},
            },
            "rx": {"max_message_size": MAX_MESSAGE_BYTES},
        },
        "shared_memory": {"enabled": False},
    }
    transport.update(settings.pop("transport", {}))
    return {**common, **settings, "transport": transport}


def _config(settings: dict[str, Any]) -> zenoh.Config:
    return zenoh.Config.from_json5(json.dumps(settings))


def client_config(connect: Sequence[str]) -> zenoh.Config:
    """Return the configuration of a process of the site."""
    retry = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
    return _config(_settings("client", {"connect": {"endpoints": list(connect), "timeout_ms": 2000, "retry": retry}}))


def router_config(listen: Sequence[str]) -> zenoh.Config:
    """Return the configuration of the router in a Python process."""
    return _config(router_settings(listen))


def router_settings(listen: Sequence[str]) -> dict[str, Any]:
    """Return the settings of a router, also of `zenohd`; it turns away what is too large for its channel."""
    by_limit: dict[int, list[str]] = {}
    for channel in CHANNELS:
        if channel.kind not in (Kind.LIVELINESS, Kind.QUERY):
            by_limit.setdefault(size_limit(channel), []).append(channel.key())
    return _settings(
        "router",
        {
            "listen": {"endpoints": list(listen)},
            "low_pass_filter": [
                {
                    "id": f"at_most_{limit}",
                    "flows": ["ingress"],
                    "messages": ["put", "delete"],
                    "key_exprs": keys,
                    "size_limit": limit,
                }
                for limit, keys in sorted(by_limit.items())
            ],
            # Idle connections must not keep new ones out (150 of them block the default for 11 s).
            "transport": {"unicast": {"accept_pending": 1000, "accept_timeout": 1000, "max_sessions": 2000}},
        },
    )


async def connect(endpoints: Sequence[str]) -> zenoh.Session:
    """Return a session as soon as one of the routers answers, however long that takes; cancel it to give up."""
    config = client_config(endpoints)
    wait_s, logged = 0.1, float("-inf")
    while True:
        opening = asyncio.ensure_future(asyncio.to_thread(zenoh.open, config))
        try:
            return await asyncio.shield(opening)
        except asyncio.CancelledError:
            opening.add_done_callback(_close_late)
            raise
        except zenoh.ZError as error:
            if time.monotonic() - logged >= 5.0:
                logged = time.monotonic()
                _log.warning("router_unreachable", connect=list(endpoints), error=str(error)[:300])
        await asyncio.sleep(wait_s)
        wait_s = min(2 * wait_s, 1.0)


def _close_late(opening: "asyncio.Future[zenoh.Session]") -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()

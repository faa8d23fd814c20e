"""Muster's bus: typed publish, subscribe, serve and ask over Zenoh, liveliness, and the runtime of every service.

The only package that imports Zenoh. Keys, models and kinds come from `muster_schemas.channels`.
"""

from .bus import Bus, open_bus
from .errors import (
    AlreadyRunningError,
    BusError,
    NoReplyError,
    Refusal,
    RefusedError,
    TooBigError,
    WrongMessageError,
)
from .presence import Presence
from .subscription import Received, Subscription

__all__ = [
    "AlreadyRunningError",
    "Bus",
    "BusError",
    "NoReplyError",
    "Presence",
    "Received",
    "Refusal",
    "RefusedError",
    "Subscription",
    "TooBigError",
    "WrongMessageError",
    "open_bus",
]
